"""Seconds and nanoseconds in two columns tell the rate, whatever the line of names calls them."""

import numpy as np
import pytest

from hand_log_data import draft, hand_log


TIME, ACCEL, GYRO = hand_log()


@pytest.mark.parametrize(
    "names", ["[s],!ns!", "sec,nanosec", "header.stamp.sec,header.stamp.nanosec"]
)
def test_the_rate_is_that_of_both_columns(tmp_path, names):
    """Of `[s],!ns!` nothing told the rate; of the others the seconds alone, to one in their number."""
    since = 1_729_716_663.25 + 1.0007 * TIME
    whole = np.floor(since)
    rest = np.round(1e9 * (since - whole))
    table = np.column_stack([whole, rest, ACCEL, GYRO])
    path = tmp_path / "log.csv"
    form = ["%d", "%d", *["%.6f"] * 6]
    np.savetxt(path, table, form, ",", header=f"{names},ax,ay,az,gx,gy,gz", comments="")
    tables = draft(path)
    expected = (len(TIME) - 1) / float(since[-1] - since[0])
    assert tables["columns"]["time"]["rate"] == pytest.approx(expected, rel=1e-3)
    assert (
        "seconds and nanoseconds stand in two columns" in (tmp_path / "campaign.toml").read_text()
    )
