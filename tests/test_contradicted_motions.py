"""Gyros whose motions contradict gravity are not called usable, whatever their rests agree with."""

import numpy as np
import pytest

from hand_log_data import G, hand_log
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.reduction.contradicted_motions import contradiction


SPANS = [(10.0 * k, 10.0 * k + 2.0) for k in range(8)]


def campaign(by, rests=16):
    time, accel, gyro = hand_log(rests=rests)
    return Campaign((Recording(time=time, accel=accel, gyro=gyro * by),), Site(gravity=G))


def test_most_motions_have_to_miss():
    path = np.full(8, 1.5)
    found = contradiction(np.full(8, 1.0), path, SPANS)
    assert (found.number, found.among, found.mean) == (8, 8, 1.0)
    assert found.where[3] == (30.0, 32.0, 1.0)
    assert "in 8 of 8 motions" in found.statement
    assert contradiction(np.where(np.arange(8) < 4, 1.0, 0.02), path, SPANS) is None
    assert contradiction(np.full(4, 1.0), path[:4], SPANS[:4]) is None  # fewer than a fit needs


def test_a_scale_factor_over_several_turns_is_no_contradiction():
    """5 % of 12 rad."""
    assert contradiction(np.full(8, 0.6), np.full(8, 12.0), SPANS) is None


@pytest.mark.slow
def test_the_true_reason_is_said_and_nothing_is_called_usable():
    # No exchange, unit or factor of an axis or two mends it.
    result = calibrate_device(campaign([57.0, 0.3, -4.0]))
    (reason,) = [c for c in result.choices if c.startswith("gyros: 'static'")]
    assert "motions between rests the integrated rates do not turn gravity as it turned" in reason
    assert "too fast for the sampling rate" not in reason and "one plane" not in reason
    quality = judge(result)
    assert quality.verdict == "doubtful"
    assert any("the gyros contradict the accelerometers" in f.text for f in quality.findings)


@pytest.mark.slow
def test_a_diagnosis_of_them_is_not_consistent():
    found = diagnose(campaign([57.0, 0.3, -4.0]))
    assert found.verdict == "unexplained"
    assert found.where and found.where[0].channel == "gyro"
    assert "the gyros contradict the accelerometers" in found.summary
    assert not [e for e in found.effects if any(c.startswith("gyro") for c in e.channels)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "rests, reason", [(12, "11 motions between rests tell of rates"), (24, None)]
)
def test_few_motions_are_the_reason_why_rates_are_not_judged(rests, reason):
    found = diagnose(campaign(1.0, rests))
    assert found.verdict == "consistent"
    said = [n for n in found.notes if n.startswith("rate_nonlinearity: ")]
    assert ([] if reason is None else [True]) == [reason in n for n in said]
