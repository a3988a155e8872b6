"""Start and rate as rows of numbers above the samples, as Empatica's E4 writes them."""

import numpy as np

from hand_log_data import draft, written
from inertiax.data.campaign import load_campaign


def samples(rows=200):
    up = np.repeat(64.0 * np.eye(3), rows, axis=0)
    return np.round(up + np.random.default_rng(3).normal(0.0, 0.6, up.shape))


def test_the_second_row_is_the_rate(tmp_path):
    """A public wristband's log: "nothing in the file tells the rate", and both rows were samples."""
    rows = samples()
    table = np.vstack([np.full(3, 1560279825.0), np.full(3, 32.0), rows])
    path = written(tmp_path / "ACC.csv", (table,))
    found = draft(path)
    assert found["columns"]["time"] == {"rate": 32.0}
    assert found["columns"]["accel"]["scale"] == 64.0
    assert "CHECK time" not in (tmp_path / "campaign.toml").read_text()
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.num_samples == len(rows)


def test_rows_that_are_alike_are_no_settings(tmp_path):
    table = np.vstack([np.full((2, 3), 32.0), samples()])
    found = draft(written(tmp_path / "ACC.csv", (table,)))
    assert "start_row" not in found["recordings"]
