"""Gyros that are off alike on all axes: the clock or the range, by the verdict."""

import equinox as eqx
import numpy as np

import turned_by_hand as hand
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device


def _said(stretch: float) -> list[str]:
    campaign = hand.log(5, motions=20)
    (log,) = campaign.recordings
    longer = eqx.tree_at(lambda r: r.time, log, np.asarray(log.time) * stretch)
    stretched = eqx.tree_at(lambda c: c.recordings, campaign, (longer,))
    quality = judge(calibrate_device(stretched, checked=True))
    return [f.text for f in quality.findings if "all three read" in f.text]


def test_stamps_that_are_five_percent_long_are_named_by_the_verdict():
    (text,) = _said(1.05)
    assert "too long" in text and "clock" in text
    assert abs(float(text.split("all three read ")[1].split()[0]) - 1.05 * 1.00333) < 0.003
    assert _said(1.0) == []
