"""`inertiax init` on logs in which the rows of several devices alternate."""

import numpy as np
import pytest

from hand_log_data import CANONICAL, draft, hand_log
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
_STEP = TIME[1] - TIME[0]


def _log(path, column, labels, *, offset=0.15, late=0.2, header=True, clock=True):
    """Two devices on one plate, the second `late` steps behind the first, with biases `offset` (m/s², rad/s) apart."""
    rng = np.random.default_rng(3)
    lines = [f"{column},{'time,' * clock}{CANONICAL}"] if header else []
    for t, a, w in zip(TIME, ACCEL, GYRO):
        for k, label in enumerate(labels):
            row = [*(a + k * offset + 0.01 * rng.standard_normal(3)), *(w + 0.2 * k * offset)]
            stamp = f"{t + k * late * _STEP:.4f}," * clock
            lines.append(f"{label},{stamp}{','.join(f'{v:.5f}' for v in row)}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("column", "labels"), [("node", ("A5", "B7")), ("imu", (0, 1))])
def test_the_label_that_changes_from_row_to_row_is_the_device(tmp_path, column, labels):
    """Whatever it is called; the stamps come in bursts for both together, and each has a clock of its own."""
    found = draft(_log(tmp_path / "log.csv", column, labels))["columns"]
    assert found["device"] == column
    assert found["time"] == {"name": "time", "unit": "s"}
    recordings = load_campaign(tmp_path).recordings
    assert [r.device for r in recordings] == [str(label) for label in labels]
    assert all(r.num_samples == len(TIME) for r in recordings)


def test_it_is_called_device_where_the_columns_have_no_names(tmp_path):
    """A header that is missing leaves the label as the first field."""
    found = draft(_log(tmp_path / "log.csv", "", ("A5", "B7"), header=False))
    assert found["recordings"]["names"][:2] == ["device", "time"]
    assert len(load_campaign(tmp_path).recordings) == 2


def test_a_small_difference_counts_where_the_stamps_show_the_devices(tmp_path):
    """Biases that differ by half of the noise; with rows at equal distances nothing else tells two devices."""
    found = draft(_log(tmp_path / "log.csv", "node", ("A5", "B7"), offset=0.01))["columns"]
    assert found["device"] == "node"
    (tmp_path / "even").mkdir()
    even = _log(tmp_path / "even" / "log.csv", "node", ("A5", "B7"), offset=0.01, late=0.5)
    assert "device" not in draft(even)["columns"]


def test_rows_are_counted_by_device_where_there_is_no_clock(tmp_path):
    """Gravity's turns tell the rate of one device, which is half of that of the rows."""
    found = draft(_log(tmp_path / "log.csv", "node", ("A5", "B7"), clock=False))["columns"]
    assert found["device"] == "node"
    assert found["time"]["rate"] == pytest.approx(1.0 / _STEP, rel=0.02)


@pytest.mark.parametrize("flag", ["of the rows", "of the outputs", "of bursts"])
def test_a_flag_of_one_device_is_no_device(tmp_path, flag):
    """Bits that change from row to row: a counter's last one, one that the outputs set, a buffer's number."""
    time = TIME
    bits = np.arange(len(TIME)) % 2
    if flag == "of the outputs":
        bits = ACCEL[:, 0] > np.median(ACCEL[:, 0])
        bits = np.where(np.arange(len(TIME)) % 50 < 40, ACCEL[:, 2] % 0.02 > 0.01, bits)
    if flag == "of bursts":
        time = TIME - 0.8 * _STEP * bits
    rows = [
        f"{t:.4f},{int(b)},{','.join(f'{v:.5f}' for v in (*a, *w))}"
        for t, b, a, w in zip(time, bits, ACCEL, GYRO)
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"time,bit,{CANONICAL}", *rows]) + "\n")
    assert "device" not in draft(path)["columns"]
