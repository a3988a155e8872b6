"""A table's own log of attitudes and then long turns at constant rates, with an encoder's noise, beside counts of more
than 16 bits; rotations by SciPy."""

import re

import numpy as np
import pytest

from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.scale_notes import gyro_note, temperature_note
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.delay import Clocks, compared
from table_of_two_axes import RATE, readings, smooth


LATE, LEAD = (
    40031.709,
    7.2,
)  # s: the table's clock, and by how much its log begins before the device's
COUNTS = 1.0 / 0.0009375  # per deg/s
PLACES = [(0, k) for k in (0, 90, 180, 270)] + [(90, k) for k in (270, 180, 90, 0)]
PLACES += [(45, 45), (45, 225), (135, 135), (135, 315), (180, 180), (180, 0), (225, 110), (315, 20)]
SAID = "# GYRO 0.0009375 deg/s/LSB; ACC 0.03125 mg/LSB; TEMP 0.01 degC/LSB\n"


def turns(place):
    """Rates of ±40 and ±100 deg/s about the inner axis, and the outer one twice, whole turns with ramps of 2 s."""
    rows = []
    at = place.copy()
    for axis, rate, whole in [
        (k, s * r, n) for k in (1, 0, 0) for r, n in ((40, 2), (100, 5)) for s in (1, -1)
    ]:
        count = int(RATE * (360.0 * whole / abs(rate) + 2.0))
        ramp = np.clip(
            np.minimum(np.arange(1, count + 1), count - np.arange(1, count + 1)) / (2 * RATE), 0, 1
        )
        path = np.tile(at, (count, 1))
        path[:, axis] += np.cumsum(rate * ramp) / RATE
        rows += [path, np.tile(path[-1], (int(2 * RATE), 1))]
        at = path[-1].copy()
    return np.concatenate(rows)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The device's lines below the header, and the table's file."""
    folder = tmp_path_factory.mktemp("logs")
    rng = np.random.default_rng(3)
    angles = np.zeros((int(15 * RATE), 2))
    for place in (*PLACES, (0, 0)):
        seconds = max(np.abs(place - angles[-1]).max() / 30.0, 1.0)
        move = np.stack([smooth(a, b, seconds) for a, b in zip(angles[-1], place)], axis=1)
        angles = np.concatenate([angles, move, np.tile(place, (int(20 * RATE), 1))])
    angles = np.concatenate([angles, turns(angles[-1])])
    force, rate = readings(angles)
    gyro = np.rint((np.rad2deg(rate) + [0.2, -0.1, 0.3] + rng.normal(0, 0.02, rate.shape)) * COUNTS)
    accel = np.rint((force / 9.80665 + rng.normal(0, 1e-3, force.shape)) / 0.03125e-3)
    time = np.arange(len(angles)) / RATE
    celsius = np.rint(100.0 * (-17.0 + 0.1 * np.sin(time / 60.0)))
    lines = np.column_stack([np.rint(1e6 * (time + 700.0)), gyro, accel, celsius])
    own = np.arange(-LEAD, time[-1] + 5.0, 0.05)
    seen = np.stack([np.interp(own, time, a) for a in angles.T], axis=1)
    seen = np.round(seen + rng.normal(0.0, 1e-4, seen.shape), 4) % 360.0
    np.savetxt(
        folder / "table.csv", np.column_stack([own + LATE, seen]), delimiter=";", header="Time [s];A;B",
        comments="", fmt="%.4f",
    )  # fmt: skip
    return lines, folder / "table.csv"


def drawn(folder, logs, above):
    """The draft of the logs with lines above the names."""
    lines, table = logs
    names = "TICK_US,GYRO_X,GYRO_Y,GYRO_Z,ACC_X,ACC_Y,ACC_Z,TEMP"
    np.savetxt(
        folder / "log.csv", lines, delimiter=",", header=above + names, comments="", fmt="%d"
    )
    return draft_campaign(folder / "log.csv", folder, table=table, latitude=48.0).text


@pytest.mark.slow
def test_long_turns_and_an_encoders_noise_leave_the_delay_as_it_is(tmp_path, logs):
    text = drawn(tmp_path, logs, SAID)
    assert 'table_angles = { names = ["A", "B"], unit = "deg" }' in text
    # The device's clock begins at 700 s, and counts from its first stamp. A fiftieth of a row of the table.
    found = float(re.search(r"\ndelay = (.*)\n", text)[1])
    assert min(abs(found - LATE), abs(found + 700.0 - LATE)) < 1e-3
    (tmp_path / "campaign.toml").write_text(text)
    (recording,) = load_campaign(tmp_path).recordings
    turning = np.linalg.norm(recording.reference_gyro, axis=1) > 0.1
    away = (recording.gyro - recording.reference_gyro)[turning]
    assert np.rad2deg(np.abs(np.median(away, axis=0) - np.deg2rad([0.2, -0.1, 0.3]))).max() < 0.02


def test_a_scale_above_the_names_is_taken_where_gravity_turns_by_it(tmp_path, logs):
    text = drawn(tmp_path, logs, SAID)
    gyro = re.search(r"\ngyro = .*scale = ([\d.]+),", text)[1]
    assert float(gyro) == pytest.approx(COUNTS)
    assert "CHECK gyro" not in text
    assert re.search(r"\ntemperature = .*scale = 100.0,.*offset = 0.0 }", text)
    assert "CHECK temperature" not in text


def test_counts_of_more_than_16_bits_have_the_scale_by_which_gravity_turns(tmp_path, logs):
    """65 times as coarse turns 45° by eight turns more, which is the other part that the line names."""
    text = drawn(tmp_path, logs, "# gyro 16.4 LSB/dps\n")
    found = float(re.search(r"\ngyro = .*scale = ([\d.]+),", text)[1])
    assert found == pytest.approx(COUNTS, rel=0.01)  # 1 sigma of 20 motions of 90 deg is some 0.1 %
    assert "of more than 16 bits" in text and "CHECK gyro" not in text


@pytest.mark.parametrize(
    "line, per_degree",
    [
        ("# acc 4096 LSB/g, gyro 16.4 LSB/dps, temp 256 LSB/K", 16.4),
        ("# GYRO 0.0009375 deg/s/LSB; ACC 0.03125 mg/LSB", 1.0 / 0.0009375),
        ("// Gyroscope: 4,375 mdps per digit", 1000.0 / 4.375),
        ("# angular rate 655360 counts/(deg/s)", 655360.0),
        ("# gyro 2000 dps, acc 16.4 LSB/dps", None),
        ("# gyro range 2000 deg/s", None),
        ("# acc 0.061 mg/LSB", None),
    ],
)
def test_the_gyros_scale_in_a_line(line, per_degree):
    found = gyro_note([line])
    assert found == (None if per_degree is None else pytest.approx(per_degree))


def test_a_scale_of_the_temperature_without_a_zero():
    told = temperature_note(["# gyro in counts", "# TEMP 0.01 degC/LSB"])
    assert told is not None and told.scale == pytest.approx(100.0) and told.zero is None
    assert temperature_note(["# temperature in counts, acc 4096 LSB/g"]) is None


def test_a_turn_in_the_middle_leaves_the_drift_as_it_is():
    """Gyros of which one axis is off by 1 %: a ramp without its opposite passed for a delay of a millisecond."""
    time = np.arange(0.0, 700.0, 0.01)
    turn = lambda t, begin: np.interp(
        t, begin + np.array([0.0, 2.0, 20.0, 22.0]), [0.0, 100.0, 100.0, 0.0]
    )
    begins = 20.0 + 75.0 * np.arange(9)  # the fifth has the middle of what changes
    speed = lambda t: sum(turn(t, b) for b in begins)
    read = lambda t: speed(t) + 0.01 * sum(turn(t, b) for b in begins[1::3])
    own = np.arange(0.0, 699.0, 0.05)
    late, drift = 0.3, 10.0
    table = late + own * (1.0 + 1e-6 * drift)
    found = compared(time, read(time), table, speed(own), Clocks(late, 0.0, float(table[0])))
    assert found.drift == pytest.approx(drift, abs=0.1)
    assert found.delay == pytest.approx(late, abs=1e-4)
