"""Exported numbers, put through each tool's own formula, give our compensation.

Every formula below is written here from the tool's sources or publication and reads only the file.
"""

import dataclasses
import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from exports_cases import (
    agree,
    azure_apply,
    calibration,
    constant_scale,
    GRAVITY,
    HIGH,
    LOW,
    NOISE,
    ours,
    samples,
    without_gyro_scale,
)
from inertiax.calibration.calibration import TriadCalibration
from inertiax.exports import export, measure_loss
from inertiax.physics.temperature import Constant, Curve, Polynomial


def kalibr_forward(text, force, rate):
    """IccSensors.py: predicted measurements of a true force and rate in the body frame, no bias."""
    yaml = pytest.importorskip("ruamel.yaml", reason="ruamel.yaml is not installed (with rosbags)")
    imu = yaml.YAML(typ="safe").load(text)["imu0"]
    c_i_b = np.array(imu["T_i_b"])[:3, :3]
    c_gyro_b = np.array(imu["gyroscopes"]["C_gyro_i"]) @ c_i_b
    m, m_g = np.array(imu["accelerometers"]["M"]), np.array(imu["gyroscopes"]["M"])
    accel = np.array([m @ (c_i_b @ a) for a in force])
    a = np.array(imu["gyroscopes"]["A"])
    gyro = np.array(
        [m_g @ (c_gyro_b @ w) + a @ (c_gyro_b @ f) for w, f in zip(rate, force, strict=True)]
    )
    return accel, gyro, imu


@pytest.mark.parametrize("lower", [True, False])
def test_kalibr_predicts_our_model_less_its_biases(lower):
    cal = calibration(lower=lower)
    result = export(cal, "kalibr", **NOISE["kalibr"], rostopic="/imu", update_rate=400)
    force, rate, _ = samples()
    accel, gyro, imu = kalibr_forward(result.content.decode(), force, rate)
    bias_a, bias_g = (np.asarray(p.curve(0.0))[:3] for p in (cal.accel, cal.gyro))
    agree(ours(cal, accel + bias_a, gyro + bias_g, np.zeros(len(force))), (force, rate))
    for m in (imu["accelerometers"]["M"], imu["gyroscopes"]["M"]):
        assert np.all(np.triu(np.array(m), 1) == 0)
    assert imu["model"] == "scale-misalignment"
    assert (imu["rostopic"], imu["update_rate"]) == ("/imu", 400.0)
    for key, value in NOISE["kalibr"].items():
        assert imu[key] == value


@pytest.mark.parametrize("lower", [True, False])
def test_imu_tk_files_give_our_compensation_in_its_frame(lower):
    cal = calibration(lower=lower, d=False)
    result = export(cal, "imu_tk")
    accel, gyro, temperature = samples()
    found = []
    for (tag, content), x in zip(result.files, (accel, gyro), strict=True):
        blocks = [
            np.array([line.split() for line in b.splitlines()], float)
            for b in content.decode().strip().split("\n\n")
        ]
        t, k, b = blocks
        assert t.shape == k.shape == (3, 3) and b.shape == (3, 1)
        np.testing.assert_array_equal(np.diag(t), 1.0)
        assert np.all(k == np.diag(np.diag(k)))
        if tag == "_acc":
            assert np.all(np.tril(t, -1) == 0)
        found.append(np.array([t @ k @ (v - b[:, 0]) for v in x]))
    expected = [x @ result.frame.T for x in ours(cal, accel, gyro, temperature)]
    agree(found, expected)
    np.testing.assert_allclose(result.frame @ result.frame.T, np.eye(3), atol=1e-15)


@pytest.mark.slow
def test_imucal_itself_gives_our_compensation(tmp_path):
    pytest.importorskip("imucal", reason="imucal is not installed")
    cal = calibration()
    path = tmp_path / "a.json"
    path.write_bytes(export(cal, "imucal").content)
    from imucal.management import load_calibration_info

    info = load_calibration_info(path, file_type="json")
    accel, gyro, temperature = samples()
    force, rate = info.calibrate(accel, np.rad2deg(gyro), acc_unit="m/s^2", gyr_unit="deg/s")
    agree((force, np.deg2rad(rate)), ours(cal, accel, gyro, temperature))


@pytest.mark.parametrize("lower", [True, False])
def test_aria_rectification_gives_our_compensation_in_the_device_frame(lower):
    cal = calibration(lower=lower, d=False)
    (imu,) = json.loads(export(cal, "aria", label="imu-left").content)["ImuCalibrations"]
    assert imu["Label"] == "imu-left" and imu["SerialNumber"] == "SN 7"
    w, (x, y, z) = imu["T_Device_Imu"]["UnitQuaternion"]
    # Rotation of a unit quaternion, written out.
    device_from_imu = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    accel, gyro, temperature = samples()
    found = []
    for key, raw in (("Accelerometer", accel), ("Gyroscope", gyro)):
        matrix = np.array(imu[key]["Model"]["RectificationMatrix"])
        if key == "Accelerometer":
            assert np.all(np.tril(matrix, -1) == 0)
        rectified = np.linalg.solve(matrix, (raw - imu[key]["Bias"]["Offset"]).T)
        found.append((device_from_imu @ rectified).T)
    agree(found, ours(cal, accel, gyro, temperature))


def test_projectaria_tools_itself_gives_our_compensation():
    core = pytest.importorskip(
        "projectaria_tools.core.calibration", reason="projectaria_tools is not installed"
    )
    cal = calibration(d=False)
    content = json.loads(export(cal, "aria", label="imu-left").content)
    camera = {
        "Label": "camera-slam-left",
        "SerialNumber": "1",
        "Calibrated": True,
        "T_Device_Camera": {"Translation": [0, 0, 0], "UnitQuaternion": [1, [0, 0, 0]]},
        "Projection": {
            "Name": "FisheyeRadTanThinPrism",
            "Description": "",
            "Params": [240.0, 320.0, 240.0] + [0.0] * 12,
        },
    }
    device = {
        "Serial": "1",
        "DeviceClassInfo": {"DeviceClass": "Aria", "BuildVersion": "DVT-S"},
        "OriginSpecification": {"ChildLabel": "camera-slam-left", "Type": "Custom"},
        "CameraCalibrations": [camera, camera | {"Label": "camera-slam-right"}],
        "MagnetometerCalibrations": [],
        "BarometerCalibrations": [],
        "MicrophoneCalibrations": [],
    }
    device = core.device_calibration_from_json_string(json.dumps(device | content))
    imu = device.get_imu_calib("imu-left")
    rotation = imu.get_transform_device_imu().rotation().to_matrix()
    accel, gyro, temperature = samples()
    force = [rotation @ imu.raw_to_rectified_accel(a) for a in accel]
    rate = [rotation @ imu.raw_to_rectified_gyro(w) for w in gyro]
    agree((np.array(force), np.array(rate)), ours(cal, accel, gyro, temperature))


@pytest.mark.parametrize("lower", [True, False])
def test_basalt_bias_vectors_give_our_compensation_in_its_frame(lower):
    cal = calibration(lower=lower, d=False)
    result = export(cal, "basalt", **NOISE["basalt"])
    value = json.loads(result.content)["value0"]
    accel, gyro, temperature = samples()
    b = value["calib_accel_bias"]
    s = np.zeros((3, 3))
    s[:, 0] = b[3:6]
    s[1, 1], s[2, 1], s[2, 2] = b[6:9]
    force = np.array([a + s @ a - b[:3] for a in accel])
    b = value["calib_gyro_bias"]
    s = np.stack([b[3:6], b[6:9], b[9:12]], axis=1)
    rate = np.array([w + s @ w - b[:3] for w in gyro])
    expected = [x @ result.frame.T for x in ours(cal, accel, gyro, temperature)]
    agree((force, rate), expected)
    assert value["gyro_noise_std"] == [1e-4] * 3


def test_realsense_correction_gives_our_compensation():
    cal = calibration(d=False)
    content = json.loads(export(cal, "realsense", device_type="D455").content)
    assert content["device_type"] == "D455"
    accel, gyro, temperature = samples()
    found = []
    for key, raw in (("accelerometer", accel), ("gyroscope", gyro)):
        part = content["imus"][0][key]
        # rs-imu-calibration: rows [x y z -1] times the 4 x 3 matrix that is written row by row.
        x = np.array([*part["scale_and_alignment"], *part["bias"]]).reshape(4, 3)
        found.append(np.column_stack([raw, -np.ones(len(raw))]) @ x)
    agree(found, ours(cal, accel, gyro, temperature))


@pytest.mark.slow
def test_azure_constants_are_exact_and_cubics_as_good_as_stated():
    accel, gyro, temperature = samples()
    cal = calibration(d=False)
    result = export(cal, "azure")
    found = [
        azure_apply(result.content, k, x, temperature)
        for k, x in (("accel", accel), ("gyro", gyro))
    ]
    agree(found, ours(cal, accel, gyro, temperature))

    cal = calibration(Polynomial(3, LOW, HIGH), d=False)
    result = export(cal, "azure")
    force, rate = ours(cal, accel, gyro, temperature)
    loss = measure_loss(cal, result)
    errors = [
        np.linalg.norm(azure_apply(result.content, k, x, temperature) - y, axis=1)
        for k, x, y in (("accel", accel, force), ("gyro", gyro, rate))
    ]
    # The stated errors are for forces up to g and rates up to 1 rad/s, and grow in proportion; the
    # part without input is the same for all.
    for e, y, size, stated in (
        (errors[0], force, GRAVITY, loss.force),
        (errors[1], rate, 1.0, loss.rate),
    ):
        scaled = e / np.maximum(1.0, np.linalg.norm(y, axis=1) / size)
        assert 0.1 * stated < scaled.max() < 1.5 * stated
    assert loss.force > 1e-6


def px4_parameters(content):
    found = {}
    for line in content.decode().splitlines():
        vehicle, component, name, value, kind = line.split("\t")
        assert (vehicle, component) == ("1", "1")
        assert kind == ("6" if name.endswith(("_ID", "_ENABLE")) else "9")
        found[name] = int(value) if kind == "6" else np.float32(value)
    return found


def px4_apply(found, n, accel, gyro, temperature):
    """TemperatureCompensation.cpp and Accelerometer.hpp: Correct, axis by axis; nothing thermal where TC is off."""
    results = []
    for letter, sensor, x in (("A", "ACC", accel), ("G", "GYRO", gyro)):
        p = lambda name, s=letter: float(found[f"TC_{s}{n}_{name}"])
        thermal = found[f"TC_{letter}_ENABLE"] == 1
        dt = np.clip(temperature, p("TMIN"), p("TMAX")) - p("TREF") if thermal else 0.0
        out = np.empty_like(x)
        for k, axis in enumerate("XYZ"):
            offset = 0.0
            if thermal:
                offset = p(f"X0_{k}") + p(f"X1_{k}") * dt
                offset += p(f"X2_{k}") * dt**2 + p(f"X3_{k}") * dt**3
            scale = float(found.get(f"CAL_{sensor}{n}_{axis}SCALE", 1.0))
            out[:, k] = (x[:, k] - offset - float(found[f"CAL_{sensor}{n}_{axis}OFF"])) * scale
        results.append(out)
    return results


def test_px4_gives_what_its_parameters_can_say():
    # A cubic bias and constant scale factors are all that PX4 has: then only its single precision
    # is left, eps/2 of each of five terms of at most about 0.1 m/s² and of the scale at 40 m/s².
    cal = without_gyro_scale(constant_scale(calibration(Polynomial(3, LOW, HIGH), diagonal=True)))
    result = export(cal, "px4", instance=2, accel_id=1310988, gyro_id=1310989)
    found = px4_parameters(result.content)
    assert found["TC_A2_ID"] == found["CAL_ACC2_ID"] == 1310988
    assert found["TC_G2_ID"] == found["CAL_GYRO2_ID"] == 1310989
    assert found["TC_A_ENABLE"] == found["TC_G_ENABLE"] == 1
    accel, gyro, temperature = samples()
    agree(
        px4_apply(found, 2, accel, gyro, temperature),
        ours(cal, accel, gyro, temperature),
        tolerance=3e-7,
    )
    loss = measure_loss(cal, result)
    assert loss.force < 3e-6 and loss.rate < 3e-7


@pytest.mark.parametrize("span", [None, (31.4, 32.2)])
def test_px4_of_constants_has_static_offsets_and_no_thermal_correction(span):
    """Sensor.hpp: (x' − offset) · scale, with nothing taken away before where TC is off.

    A log by hand warms a little: its calibration by constants has a range of temperatures all the same.
    """
    cal = without_gyro_scale(constant_scale(calibration(diagonal=True)))
    cal = dataclasses.replace(cal, temperature_range=span)
    found = px4_parameters(export(cal, "px4", accel_id=7, gyro_id=9).content)
    assert found["TC_A_ENABLE"] == found["TC_G_ENABLE"] == 0
    assert not any(k.startswith(("TC_A0_", "TC_G0_")) for k in found)
    accel, gyro, temperature = samples()
    axes = lambda key: np.array([float(found[f"CAL_{key.replace('*', a)}"]) for a in "XYZ"])
    static = (accel - axes("ACC0_*OFF")) * axes("ACC0_*SCALE"), gyro - axes("GYRO0_*OFF")
    agree(static, ours(cal, accel, gyro, temperature), tolerance=3e-7)


def one_triad_constant(kept, *, higher_terms):
    """A cubic bias of one triad; the other's is a constant, by its basis or by coefficients of zero."""
    cal = without_gyro_scale(constant_scale(calibration(Polynomial(3, LOW, HIGH), diagonal=True)))
    part = getattr(cal, kept)
    constant = np.asarray(part.curve.coefficients)[:1]
    if higher_terms:
        curve = Curve(part.curve.basis, jnp.asarray(np.pad(constant, ((0, 3), (0, 0)))))
    else:
        curve = Curve(Constant(), jnp.asarray(constant))
    size = curve.coefficients.size
    still = TriadCalibration(curve, jnp.zeros((size, size)), part.names, "x")
    return dataclasses.replace(cal, **{kept: still})


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
@pytest.mark.parametrize("kept", ["accel", "gyro"])
@pytest.mark.parametrize("higher_terms", [False, True])
def test_the_thermal_correction_is_of_the_triads_that_need_it(name, kept, higher_terms):
    cal = one_triad_constant(kept, higher_terms=higher_terms)
    content, batch = export(cal, name).content, samples()
    if name == "px4":
        found = px4_parameters(content)
        letter, sensor = {"accel": ("A", "ACC"), "gyro": ("G", "GYRO")}[kept]
        other, moving = {"accel": ("G", "GYRO"), "gyro": ("A", "ACC")}[kept]
        assert (found[f"TC_{letter}_ENABLE"], found[f"TC_{other}_ENABLE"]) == (0, 1)
        assert not any(k.startswith(f"TC_{letter}0_") for k in found)
        assert all(found[f"CAL_{moving}0_{a}OFF"] == 0 for a in "XYZ")
        bias = np.asarray(getattr(cal, kept).curve.coefficients)[0, :3]
        offsets = [float(found[f"CAL_{sensor}0_{a}OFF"]) for a in "XYZ"]
        np.testing.assert_allclose(offsets, bias, rtol=1e-7)  # single precision
        applied = px4_apply(found, 0, *batch)
    else:
        still = {"accel": "ACC", "gyro": "GYR"}[kept]
        values = dict(line.split() for line in content.decode().splitlines())
        assert values["INS_TCAL1_ENABLE"] == "1"
        assert {values[f"INS_TCAL1_{still}{k}_{a}"] for k in (1, 2, 3) for a in "XYZ"} == {"0"}
        applied = ardupilot_apply(content, 1, *batch)
    agree(applied, ours(cal, *batch), tolerance=3e-7)


@pytest.mark.parametrize(
    ("name", "accel", "gyro"),
    [("px4", ("TC_A", "CAL_ACC"), ("TC_G", "CAL_GYRO")), ("ardupilot", ("INS_ACC",), ("INS_GYR",))],
)
@pytest.mark.parametrize("kept", ["accel", "gyro"])
def test_a_triad_that_was_not_calibrated_keeps_what_the_autopilot_has(name, accel, gyro, kept):
    cal = calibration(Polynomial(3, LOW, HIGH))
    gone = "gyro" if kept == "accel" else "accel"
    cal = eqx.tree_at(lambda c: getattr(c, gone), cal, None)
    lines = export(cal, name).content.decode().split()
    mine, others = (accel, gyro) if kept == "accel" else (gyro, accel)
    assert any(word.startswith(mine) for word in lines)
    assert not any(word.startswith(others) for word in lines)


def ardupilot_apply(content, n, accel, gyro, temperature):
    """AP_InertialSensor: TCal::correct_sensor, then offset, then scale."""
    found = dict(line.split() for line in content.decode().splitlines())
    found = {k: float(np.float32(v)) for k, v in found.items()}
    low, high = (found.get(f"INS_TCAL{n}_{k}", 0.0) for k in ("TMIN", "TMAX"))
    number = "" if n == 1 else str(n)
    results = []
    for key, x in (("ACC", accel), ("GYR", gyro)):

        def polynomial(t, axis, key=key):
            d = np.clip(t, low, high) - 35.0
            c = [found[f"INS_TCAL{n}_{key}{order}_{axis}"] for order in (1, 2, 3)]
            return (c[0] + (c[1] + c[2] * d) * d) * d * 1e-6

        out = np.empty_like(x)
        for k, axis in enumerate("XYZ"):
            value = x[:, k]
            if found[f"INS_TCAL{n}_ENABLE"] == 1:
                value = value - polynomial(temperature, axis)
                value = value + polynomial(found[f"INS_{key}{n}_CALTEMP"], axis)
            value = value - found[f"INS_{key}{number}OFFS_{axis}"]
            if key == "ACC":
                value = value * found[f"INS_ACC{number}SCAL_{axis}"]
            out[:, k] = value
        results.append(out)
    return results


@pytest.mark.parametrize(
    ("device", "px4", "ardupilot"),
    [("imu1", "TC_A1_ID", "INS_ACC2"), ("7", "TC_A0_ID", "INS_ACCO")],
)
def test_a_log_names_the_place_of_its_imus(device, px4, ardupilot):
    """PX4 counts its sensors from zero, ArduPilot from one, and its first one has no number."""
    cal = dataclasses.replace(calibration(Polynomial(3, LOW, HIGH), diagonal=True), device=device)
    assert px4.encode() in export(cal, "px4", accel_id=1, gyro_id=2).content
    assert f"\n{ardupilot}".encode() in export(cal, "ardupilot").content
    other = export(cal, "ardupilot", instance=3)
    assert b"\nINS_ACC3OFFS_X" in other.content
    assert any("instance = 2" in note for note in other.notes) == (device == "imu1")


@pytest.mark.parametrize("n", [1, 2])
def test_ardupilot_gives_what_its_parameters_can_say(n):
    cal = without_gyro_scale(constant_scale(calibration(Polynomial(3, LOW, HIGH), diagonal=True)))
    result = export(cal, "ardupilot", instance=n)
    accel, gyro, temperature = samples()
    agree(
        ardupilot_apply(result.content, n, accel, gyro, temperature),
        ours(cal, accel, gyro, temperature),
        tolerance=3e-7,
    )


def test_ardupilot_constants_need_no_thermal_part():
    cal = without_gyro_scale(calibration(diagonal=True))
    cal = dataclasses.replace(cal, temperature_range=(31.4, 32.2))
    result = export(cal, "ardupilot")
    thermal = [w for w in result.content.decode().split() if w.startswith("INS_TCAL1_")]
    assert thermal == ["INS_TCAL1_ENABLE"]
    accel, gyro, temperature = samples()
    agree(
        ardupilot_apply(result.content, 1, accel, gyro, temperature),
        ours(cal, accel, gyro, temperature),
        tolerance=3e-7,
    )
