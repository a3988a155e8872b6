"""Corrections that a flight controller made before it logged, by its own formulas, written anew from its sources."""

import numpy as np
import pytest

from inertiax.campaign_draft.controller_log import correction_remarks
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import read_recordings
from inertiax.data.formats.ulog_corrections import doubt_about
from inertiax.plausibility import check_campaign
from readers_cases import made_up
from readers_data import COLUMNS, dataflash, raw_log, sensor_rows, ulog


SINGLE = 1e-6  # of 10 m/s² and of 1 rad/s: some roundings of the log's 32-bit floats
LOW, HIGH = 20.0, 45.0  # °C, TMIN and TMAX
CALTEMP = 30.0
OFFSET = {"ACC": np.array([0.3, -0.2, 0.1]), "GYR": np.array([0.01, -0.02, 0.03])}
SCALE = np.array([1.01, 0.98, 1.003])
THERMAL = {  # m/s² and rad/s times 10⁶ per °C, °C², °C³
    "ACC": np.array([[2000.0, -1000.0, 500.0], [30.0, 20.0, -10.0], [1.0, -0.5, 0.2]]),
    "GYR": np.array([[100.0, 50.0, -80.0], [2.0, -1.0, 3.0], [0.1, 0.05, -0.02]]),
}


def _warming():
    data = made_up()
    return data | {"temperature": np.linspace(10.0, 50.0, len(data["time"]))}  # beyond both ends


def _corrected(raw, temperature, key, *, thermal=True):
    """`AP_InertialSensor_Backend::_rotate_and_correct_accel` and `TCal::correct_sensor`, row by row."""
    found = []
    for v, t in zip(raw, temperature, strict=True):
        if thermal:
            for sign, at in ((-1.0, t), (1.0, CALTEMP)):
                d = min(max(at, LOW), HIGH) - 35.0
                c = THERMAL[key]
                v = v + sign * (c[0] + (c[1] + c[2] * d) * d) * d * 1e-6
        v = v - OFFSET[key]
        found.append(v * SCALE if key == "ACC" else v)
    return np.array(found)


def _parameters(values, stamp=1000):
    return (
        "PARM",
        ("TimeUS", "Name", "Value"),
        [(stamp, k.encode(), v) for k, v in values.items()],
    )


def _imu(number="", thermal="1"):
    """The parameters of an IMU whose static ones carry that number."""
    named = {
        f"INS_{k}{number}OFFS_{a}": v for k in OFFSET for a, v in zip("XYZ", OFFSET[k], strict=True)
    }
    named |= {f"INS_ACC{number}SCAL_{a}": v for a, v in zip("XYZ", SCALE, strict=True)}
    named |= {f"INS_TCAL{thermal}_ENABLE": 1.0, f"INS_TCAL{thermal}_TMIN": LOW}
    named |= {f"INS_TCAL{thermal}_TMAX": HIGH}
    for key, orders in THERMAL.items():
        named[f"INS_{key}{thermal}_CALTEMP"] = CALTEMP
        for order, values in enumerate(orders, start=1):
            for axis, value in zip("XYZ", values, strict=True):
                named[f"INS_TCAL{thermal}_{key}{order}_{axis}"] = value
    return named


def _as_logged(data, *, thermal=True):
    t = data["temperature"]
    return data | {
        "accel": _corrected(data["accel"], t, "ACC", thermal=thermal),
        "gyro": _corrected(data["gyro"], t, "GYR", thermal=thermal),
    }


def _same(recording, data):
    np.testing.assert_allclose(recording.accel, data["accel"], rtol=0, atol=10 * SINGLE)
    np.testing.assert_allclose(recording.gyro, data["gyro"], rtol=0, atol=SINGLE)


@pytest.mark.parametrize("instance", [0, 1])
def test_what_ardupilot_corrected_is_taken_away_again(tmp_path, instance):
    data, number = _warming(), "" if instance == 0 else str(instance + 1)
    told = _parameters(_imu(number, str(instance + 1)))
    dataflash(tmp_path / "a.bin", _as_logged(data), instances=(instance,), others=[told])
    (recording,) = read_recordings(tmp_path / "a.bin")
    _same(recording, data)
    (note,) = recording.notes
    for name in (f"INS_ACC{number}OFFS", f"INS_ACC{number}SCAL", f"INS_TCAL{instance + 1}"):
        assert name in note
    assert f"INS_GYR{number}OFFS" in note and not recording.reservations


def test_another_imus_corrections_are_not_this_ones(tmp_path):
    data = _warming()
    dataflash(tmp_path / "a.bin", data, others=[_parameters(_imu("2", "2"))])
    (recording,) = read_recordings(tmp_path / "a.bin")
    _same(recording, data)
    assert not recording.notes


def test_an_offset_that_is_learnt_anew_counts_from_its_message_on(tmp_path):
    data = _warming()
    late = data["time"] > data["time"][200]
    logged = data | {
        "gyro": data["gyro"] - np.where(late[:, None], [0.03, 0.0, 0.0], [0.01, 0.0, 0.0])
    }
    stamp = int(round(1e6 * data["time"][200])) + 1
    rows = [(1000, b"INS_GYROFFS_X", 0.01), (stamp, b"INS_GYROFFS_X", 0.03)]
    dataflash(tmp_path / "a.bin", logged, others=[("PARM", ("TimeUS", "Name", "Value"), rows)])
    (recording,) = read_recordings(tmp_path / "a.bin")
    _same(recording, data)


def test_temperatures_being_learnt_correct_nothing(tmp_path):
    """INS_TCAL1_ENABLE = 2: `correct_sensor` does nothing."""
    data = _warming()
    told = _parameters(_imu() | {"INS_TCAL1_ENABLE": 2.0})
    dataflash(tmp_path / "a.bin", _as_logged(data, thermal=False), others=[told])
    (recording,) = read_recordings(tmp_path / "a.bin")
    _same(recording, data)


def test_what_cannot_be_taken_away_is_a_warning(tmp_path):
    data = _warming()
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.8\n[recordings]\nfiles = ["a.bin"]\n'
    )
    said = lambda: [
        f for f in check_campaign(load_campaign(tmp_path)).findings if f.kind == "corrected"
    ]

    turned = _parameters({"INS_ACCOFFS_X": 0.3, "AHRS_ORIENTATION": 4.0})
    dataflash(tmp_path / "a.bin", data, others=[turned])
    (found,) = said()
    assert found.severity == "warning" and "after INS_ACCOFFS, which cannot" in found.statement
    assert "AHRS_ORIENTATION turned them" in found.statement
    np.testing.assert_allclose(
        read_recordings(tmp_path / "a.bin")[0].accel, data["accel"], rtol=SINGLE
    )

    dataflash(tmp_path / "a.bin", data, others=[_parameters({"AHRS_ORIENTATION": 4.0})])
    (found,) = said()
    assert "in the vehicle's axes, by AHRS_ORIENTATION" in found.statement

    cold = tuple(c for c in COLUMNS if c != "T")
    dataflash(tmp_path / "a.bin", data, columns=cold, others=[_parameters(_imu())])
    assert len(said()) == 2 and all("INS_TCAL1, which cannot" in f.statement for f in said())
    (first, _, *_) = correction_remarks(tmp_path / "a.bin")
    assert first.startswith("CHECK a.bin IMU[0]: its accel values are after INS_ACCOFFS, ")

    dataflash(tmp_path / "a.bin", data)
    assert not said() and "no parameters (PARM)" in load_campaign(tmp_path).notes[0]


def test_a_compass_comes_without_matrix_scale_and_motor(tmp_path):
    """`AP_Compass_Backend::correct_field`: offsets, scale, matrix, then the motor's part."""
    data = made_up()
    raw = np.array([210.0, -50.0, 430.0])  # mgauss
    offset, motor = np.array([12.0, -30.0, 5.0]), np.array([1.0, 2.0, -3.0])
    matrix = np.array([[1.1, 0.05, -0.02], [0.05, 0.9, 0.03], [-0.02, 0.03, 1.05]])
    field = matrix @ (1.2 * (raw + offset)) + motor
    stamps = (1e6 * data["time"][3::20]).round().astype(int).tolist()
    fields = ("TimeUS", "I", *(f"{k}{a}" for k in ("Mag", "Ofs", "MO") for a in "XYZ"))
    values = {"COMPASS_SCALE": 1.2}
    values |= {f"COMPASS_DIA_{a}": matrix[k, k] for k, a in enumerate("XYZ")}
    values |= {"COMPASS_ODI_X": 0.05, "COMPASS_ODI_Y": -0.02, "COMPASS_ODI_Z": 0.03}
    rows = [(t, 0, *field, *offset, *motor) for t in stamps]
    dataflash(tmp_path / "a.bin", data, others=[("MAG", fields, rows), _parameters(values)])
    (recording,) = read_recordings(tmp_path / "a.bin")
    seen = recording.mag[~np.isnan(recording.mag[:, 0])]
    # Differences of 32-bit numbers of some hundred mgauss, in T.
    np.testing.assert_allclose(seen, np.tile(1e-7 * raw, (len(stamps), 1)), rtol=0, atol=1e-11)
    assert "COMPASS_DIA, COMPASS_ODI, COMPASS_SCALE (PARM)" in recording.notes[0]


ACTIVE = {"CAL_ACC0_ID": 1310988, "CAL_ACC0_XOFF": 0.3, "TC_A_ENABLE": 1}


def test_px4s_combined_topic_is_said_to_be_corrected(tmp_path):
    pytest.importorskip("pyulog", reason="pyulog is not installed (inertiax[px4])")
    data = made_up()
    stamps = (1e6 * data["time"]).round().astype(int).tolist()
    rows = [(t, *w, *a) for t, w, a in zip(stamps, data["gyro"], data["accel"], strict=True)]
    head = '[site]\ngravity = 9.8\n[recordings]\nfiles = ["a.ulg"]\ntopic = "sensor_combined"\n'
    (tmp_path / "campaign.toml").write_text(head)
    for parameters, count in ((ACTIVE, 1), ({"CAL_ACC0_ID": 1310988, "CAL_ACC0_XSCALE": 1.0}, 0)):
        ulog(tmp_path / "a.ulg", [("sensor_combined", 0, rows)], parameters=parameters)
        found = check_campaign(load_campaign(tmp_path)).findings
        told = [f.statement for f in found if f.kind == "corrected"]
        assert len(told) == count
    ulog(tmp_path / "a.ulg", [("sensor_combined", 0, rows)], parameters=ACTIVE)
    (recording,) = load_campaign(tmp_path).recordings
    assert "values after CAL_ACC0, TC_A_ENABLE, in the vehicle's axes" in recording.reservations[0]


def test_px4s_raw_topics_were_corrected_before_release_1_12(tmp_path):
    pytest.importorskip("pyulog", reason="pyulog is not installed (inertiax[px4])")
    data = made_up()
    streams = [(f"sensor_{k}", 0, sensor_rows(data, k)) for k in ("accel", "gyro")]
    said = {}
    for release in (0x010A01FF, 0x010C00FF):  # 1.10.1 and 1.12.0
        ulog(tmp_path / "a.ulg", streams, parameters=ACTIVE, release=release)
        (recording,) = read_recordings(tmp_path / "a.ulg")
        said[release] = recording.reservations
    (doubt,) = said[0x010A01FF]
    assert "before PX4 1.12" in doubt and "after CAL_ACC0:" in doubt
    assert said[0x010C00FF] == ()
    raw_log(tmp_path / "a.ulg", data)
    assert read_recordings(tmp_path / "a.ulg")[0].reservations == ()
    # Of another sensor than those in the log.
    assert doubt_about("sensor_accel", ACTIVE, 0x010A01FF, {7}) is None
