"""`inertiax init` on whole numbers whose header states a number before a unit, `gyroscope x (0.1 deg/s)`, or a unit.

A public log of an x-BIMU's Android app writes tenths of deg/s, thousandths of g and of gauss so. The data are the hand
log of these tests.
"""

import numpy as np
import pytest

from hand_log_data import DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft.stated_scales import stated_force_scale, stated_rate_scale
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()


def at_rest(per_degree, bias=(-0.4, 0.1, 0.0), noise=0.05, rows=2000):
    """Whole numbers of gyros that stand, flat on a table, but for one turn about the vertical."""
    rng = np.random.default_rng(1)
    rate = np.array(bias) + noise * rng.standard_normal((rows, 3))
    rate[900:1000, 2] += 60.0
    force = np.array([0.03, 0.0, 0.98]) + 0.002 * rng.standard_normal((rows, 3))
    return np.arange(rows) / 100.0, np.round(1000.0 * force), np.round(per_degree * rate)


def header(accel, gyro):
    return ",".join(
        ["t (s)", *(f"a{x} ({accel})" for x in "xyz"), *(f"g{x} ({gyro})" for x in "xyz")]
    )


@pytest.mark.parametrize(
    "words", ["0.1 deg/s", "0.1°/s", "x0.1 dps", "1/10 deg/s", "10 LSB/dps", "100 mdps"]
)
def test_tenths_of_a_degree_are_what_the_header_states(tmp_path, words):
    """It was 131 counts per deg/s, marked CHECK: no motion tilts the device."""
    path = written(tmp_path / "log.csv", at_rest(10.0), header("mg", words))
    found = draft(path)
    gyro = found["columns"]["gyro"]
    assert (gyro["unit"], gyro["scale"], gyro["scale_unit"]) == ("count", 10.0, "count per deg/s")
    assert "CHECK gyro" not in (tmp_path / "campaign.toml").read_text()
    (recording,) = load_campaign(tmp_path).recordings
    # Tenths are rounded to ± 0.05 deg/s, whose mean over rows with as much noise is true to some thousandths.
    assert np.allclose(recording.gyro[:800].mean(axis=0) / DEGREE, (-0.4, 0.1, 0.0), atol=0.01)


def test_small_whole_numbers_beside_a_stated_scale_are_counts(tmp_path):
    """Of a device that never turns none is beyond 50, and they were taken for deg/s."""
    time, accel, gyro = (x[:800] for x in at_rest(10.0))
    assert np.abs(gyro).max() < 10
    gyro = draft(written(tmp_path / "log.csv", (time, accel, gyro), header("mg", "0.1 deg/s")))[
        "columns"
    ]["gyro"]
    assert (gyro["unit"], gyro["scale"]) == ("count", 10.0)


@pytest.mark.parametrize("words, scale", [("0.01 g", 100.0), ("x0.001 g", 1000.0), ("4 mg", 250.0)])
def test_a_stated_scale_of_accelerometers_that_gravity_agrees_with(tmp_path, words, scale):
    counts = np.round(ACCEL / G * scale), np.round(GYRO / DEGREE * 100.0)
    path = written(tmp_path / "log.csv", (TIME, *counts), header(words, "0.01 deg/s"))
    found = draft(path)["columns"]
    assert (found["accel"]["unit"], found["accel"]["scale"]) == ("count", scale)
    assert (found["gyro"]["scale"], found["gyro"]["scale_unit"]) == (100.0, "count per deg/s")
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK accel" not in text and "CHECK gyro" not in text


def test_a_range_beside_the_name_is_no_scale(tmp_path):
    counts = np.round(ACCEL / G * 16384.0), np.round(GYRO / DEGREE * 131.0)
    found = draft(written(tmp_path / "log.csv", (TIME, *counts), header("2 g", "250 dps")))[
        "columns"
    ]
    assert found["accel"]["scale"] == 16384.0 and found["gyro"]["scale"] == 131.0


def test_a_stated_scale_that_gravity_contradicts_is_to_be_checked(tmp_path):
    counts = np.round(ACCEL / G * 16384.0), np.round(GYRO / DEGREE * 131.0)
    found = draft(written(tmp_path / "log.csv", (TIME, *counts), header("g", "0.1 deg/s")))[
        "columns"
    ]
    assert found["gyro"]["scale"] == 131.0
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK gyro" in text and "but the file says 0.1 deg/s a count" in text


@pytest.mark.parametrize(
    "bias, noise, sure", [(0.5, 0.3, True), (45.0, 0.3, False), (0.5, 6.0, False)]
)
def test_whole_numbers_have_the_unit_that_the_header_says(tmp_path, bias, noise, sure):
    """Nothing else tells it; as much noise, or as large a zero, is that of raw counts."""
    columns = at_rest(1.0, (bias, 0.0, 0.0), noise)
    found = draft(written(tmp_path / "log.csv", columns, header("mg", "deg/s")))["columns"]
    assert found["gyro"]["unit"] == "deg/s"
    text = (tmp_path / "campaign.toml").read_text()
    assert ("CHECK gyro" not in text) == sure and ("may be raw counts" in text) != sure


def test_whole_numbers_beyond_any_gyro_are_counts_whatever_the_header_says(tmp_path):
    found = draft(written(tmp_path / "log.csv", at_rest(131.0), header("mg", "deg/s")))["columns"]
    assert (found["gyro"]["unit"], found["gyro"]["scale"]) == ("count", 131.0)
    assert (
        "the file says deg/s, in which no gyro turns as fast"
        in (tmp_path / "campaign.toml").read_text()
    )


@pytest.mark.parametrize(
    "hint, scale",
    [
        ("gx (8.75 mdps)", 114.2857), ("wx [x0.01 rad/s]", 100.0), ("gx 0.07 dps/lsb", 14.28571), ("gx_0.1dps", 10.0),
        ("gx (131 lsb/(°/s))", 131.0), ("gx (0,01 °/s)", 100.0),
        ("gx (0.1 deg/s) gy (0.2 deg/s)", None),
        ("gx [±250dps]", None), ("gx (1 mdps)", None),
        ("gyro_1_rad/s", None), ("w1 (deg/s)", None), ("gx (0.1 deg)", None),
    ],
)  # fmt: skip
def test_scales_in_words(hint, scale):
    found = stated_rate_scale(hint)
    assert (found and found.scale) == scale


@pytest.mark.parametrize(
    "hint, factor",
    [
        ("ax (16384 lsb/g)", G / 16384), ("ax [1/100 m/s^2]", 0.01), ("ax (10 mm/s²)", 0.01),
        ("ax 0.061 mg/lsb", 0.061e-3 * G), ("ax (m/s^2)", None), ("ax (1 mg)", None), ("acc1 g", None),
        ("mx 0.1 gauss", None), ("ax (0.01 m/s)", None),
    ],
)  # fmt: skip
def test_scales_of_forces_in_words(hint, factor):
    found = stated_force_scale(hint)
    assert found is None if factor is None else found.factor == pytest.approx(factor, rel=1e-6)
