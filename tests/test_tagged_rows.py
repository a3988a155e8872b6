"""Logs of which each row is one sensor's, told by a word or a number: refused, with a cure that is run here."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from hand_log_data import draft, hand_log
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()


def interleaved(form, tags, accel=ACCEL, gyro=GYRO):
    """Rows of both triads by turns: `form` has a tag, a stamp in ms and three values."""
    lines = []
    for t, *both in zip(TIME, accel, gyro):
        lines += [form.format(g, 1e3 * t, *v) for g, v in zip(tags, both, strict=True)]
    return "\n".join(lines) + "\n"


FORMS = {
    "a word first": ("{0} {1:.0f} {2:.6f} {3:.6f} {4:.6f}", ("acc", "gyro"), ""),
    "a word behind the stamp": ("{1:.0f},{0},{2:.6f},{3:.6f},{4:.6f}", ("ACC", "GYR"), ""),
    "Android's numbers of sensors": ("{1:.0f} {0} {2:.6f} {3:.6f} {4:.6f}", (1, 4), ""),
    "a number first": ("{0};{1:.0f};{2:.6f};{3:.6f};{4:.6f}", (0, 1), ""),
    "a header": ("{1:.0f}, {0}, {2:.6f}, {3:.6f}, {4:.6f}", (1, 4), "time_ms, type, x, y, z\n"),
    "tabs": ("{1:.0f}\t{0}\t{2:.6f}\t{3:.6f}\t{4:.6f}", ("accel", "gyro"), "t_ms\twhat\tx\ty\tz\n"),
}


@pytest.mark.parametrize(("form", "tags", "header"), FORMS.values(), ids=FORMS)
def test_the_cure_makes_logs_that_are_read(tmp_path, form, tags, header):
    """A public log of Android has `2954776825027 2 -3.79 4.08 3.02`: stamp, sensor, x, y, z. The stamp, the number and
    one axis were taken for accelerometers of 3e12 counts per g."""
    path = tmp_path / "log.txt"
    path.write_text(header + interleaved(form, tags))
    with pytest.raises(ValueError, match=r"each row is of one sensor, named in \w+ \(") as refused:
        draft(path)
    if shutil.which("awk") is None:
        pytest.skip("no awk")
    (command,) = re.findall(r"\((awk .*), and so on\)", str(refused.value))
    other = command.replace("accel.txt", "gyro.txt").replace(f" {tags[0]}'", f" {tags[1]}'")
    other = other.replace(f'"{tags[0]}"', f'"{tags[1]}"')
    for made in (command, other):
        subprocess.run(made, shell=True, check=True, cwd=tmp_path)
    draft(tmp_path / "accel.txt", gyro=tmp_path / "gyro.txt")
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-6)
    np.testing.assert_allclose(recording.gyro, GYRO, atol=1e-6)


def test_devices_side_by_side_are_no_sensors(tmp_path):
    """Rows by turns of two devices that lie on different faces: both have gravity."""
    other = ACCEL @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    path = tmp_path / "log.csv"
    text = interleaved("{0},{2:.6f},{3:.6f},{4:.6f}", (1, 2), ACCEL, other)
    path.write_text("unit_id,ax,ay,az\n" + text)
    assert draft(path)["columns"]["device"] == "unit_id"
    path.write_text("no,ax,ay,az\n" + text)
    assert "accel" in draft(path)["columns"]


def test_coarse_gyros_are_no_numbers_of_sensors(tmp_path):
    """At rest an axis has few whole counts, which change from row to row and say nothing of the others."""
    rng = np.random.default_rng(0)
    gyro = rng.integers(-1, 2, size=(2000, 3))
    accel = np.round(np.array([30.0, -20.0, 256.0]) + rng.normal(size=(2000, 3)))
    path = tmp_path / "log.txt"
    np.savetxt(path, np.column_stack([gyro, accel]), fmt="%d")
    assert draft(path)["columns"]["accel"]["unit"] == "count"
