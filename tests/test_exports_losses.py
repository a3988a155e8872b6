"""What exports lose is stated with its true size; what was written reads back."""

import dataclasses

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
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.exports import by_name, export, FORMATS, measure_loss
from inertiax.exports.registry import loses
from inertiax.exports.triangular import lower_times_rotation, upper_times_rotation
from inertiax.physics.temperature import Constant, Curve, Polynomial


@pytest.mark.parametrize("module", FORMATS, ids=lambda m: m.NAME)
def test_the_stated_error_is_that_of_the_file(module):
    """Where a tool can say all, the stated error is rounding; else it is what we see independently."""
    cal = calibration(diagonal=False, d=False)
    result = export(cal, module.NAME, **NOISE.get(module.NAME, {}))
    loss = measure_loss(cal, result)
    lossy = {
        "kalibr": (0.02, 0.02),  # biases
        "px4": (0.1, 0.01),  # misalignments
        "ardupilot": (0.1, 0.01),
    }
    if module.NAME in lossy:
        force, rate = lossy[module.NAME]
        assert loss.force > force and loss.rate > rate and result.losses
    else:
        assert loss.force < 1e-12 and loss.rate < 1e-13 and not result.losses


def test_stated_error_of_lost_g_sensitivity_is_its_norm():
    cal = calibration()
    loss = measure_loss(cal, export(cal, "realsense"))
    errors = cal.gyro_errors(20.0)
    d = np.linalg.solve(np.eye(3) + np.asarray(errors.matrix), np.asarray(errors.g_sensitivity))
    # At 1 g no force gives more than the largest singular value; 26 directions come near it.
    largest = np.linalg.svd(d)[1][0]
    assert 0.8 * largest < loss.rate <= largest * (1 + 1e-12)
    assert abs(loss.rate - loss.rate_at_rest) < 1e-12


def test_stated_error_of_a_frozen_temperature_is_seen_at_the_end_of_the_range():
    basis = Polynomial(1, LOW, HIGH)
    cal = Calibration(
        gravity=GRAVITY,
        accel=TriadCalibration(
            Curve(basis, jnp.array([[0.0], [0.03]])), jnp.zeros((2, 2)), ("accel.bias[0]",), "x"
        ),
        temperature_range=(LOW, HIGH),
    )
    loss = measure_loss(cal, export(cal, "realsense"))
    # bias = 0.03 x with x = -1…1: frozen at mid-range it is wrong by 0.03 at both ends.
    assert loss.force == pytest.approx(0.03, rel=1e-12)
    assert loss.force_at_rest == pytest.approx(0.03, rel=1e-12)
    assert loss.force_at in (LOW, HIGH)
    warm = measure_loss(cal, export(cal, "realsense", temperature=HIGH))
    assert warm.force == pytest.approx(0.06, rel=1e-12) and warm.force_at == LOW


def accel_of(coefficients, names):
    """Accelerometers of a polynomial over the whole range, alone."""
    values = np.asarray(coefficients, float)
    curve = Curve(Polynomial(len(values) - 1, LOW, HIGH), jnp.asarray(values))
    triad = TriadCalibration(curve, jnp.zeros((values.size, values.size)), names, "x")
    return Calibration(gravity=GRAVITY, accel=triad, temperature_range=(LOW, HIGH))


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_losses_that_a_calibration_does_not_have_are_not_told(name):
    names = ("accel.bias[0]", "accel.matrix[0,0]", "accel.matrix[1,0]")
    quadratic = accel_of([[0.1, 0.01, 0.0], [0.02, 0.0, 0.0], [0.01, 0.0, 0.0]], names)
    result = export(quadratic, name)
    assert result.losses == ()
    said = measure_loss(quadratic, result).sentence
    assert said.endswith("the tool's results are the calibration's, but for rounding")

    skewed = accel_of([[0.1, 0.01, 0.002], [0.02, 0.0, 0.0]], names)
    result = export(skewed, name)
    assert result.losses == ("the accelerometers' misalignments",)
    said = measure_loss(skewed, result).sentence
    assert (
        "; the biases lose nothing" in said and "rad/s" not in said and "also without" not in said
    )

    scale = accel_of([[0.1, 0.01, 0.0], [0.02, 0.001, 0.0]], names)
    (only,) = export(scale, name).losses
    assert only == "the change of the accelerometers' scale factors with temperature"

    # 4 mm/s² of T₄: the least that a polynomial of lower degree leaves of it is all of it (Chebyshev).
    fourth = accel_of([[0.1, 0.0, 0.0], *[[0.0] * 3] * 3, [0.004, 0.0, 0.0]], names)
    result = export(fourth, name)
    assert result.losses == (
        "the part of the biases that no cubic in temperature follows (up to 0.004 m/s²)",
    )
    assert (
        "; of this 0.004 m/s² also without specific force" in measure_loss(fourth, result).sentence
    )


def test_a_format_of_one_temperature_loses_none_of_what_does_not_move():
    names = ("accel.bias[0]", "accel.matrix[1,0]")
    still = accel_of([[0.1, 0.01], [0.0, 0.0]], names)
    for name in ("realsense", "azure"):
        assert export(still, name).losses == ()
    moving = accel_of([[0.1, 0.01], [0.01, 0.0]], names)
    (said,) = export(moving, "realsense").losses
    assert said.startswith("dependence on temperature")
    # The inverse of a constant matrix times a bias of degree 1 is a polynomial of degree 1.
    assert export(moving, "azure").losses == ()


def test_every_format_says_which_sensors_it_has_no_place_for():
    told = {m.NAME: loses(m).split(", ") for m in FORMATS}
    held = [name for name, lost in told.items() if "magnetometers" not in lost]
    assert held == ["px4", "ardupilot", "c", "inertiax"]
    assert [name for name, lost in told.items() if "barometer" not in lost] == ["px4", "inertiax"]


def test_matrices_split_into_a_triangle_and_a_rotation():
    matrix = np.eye(3) + 0.3 * np.random.default_rng(0).standard_normal((3, 3))
    for split, zero in ((lower_times_rotation, np.triu), (upper_times_rotation, np.tril)):
        triangle, rotation = split(matrix)
        np.testing.assert_allclose(triangle @ rotation, matrix, atol=1e-15)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(rotation) > 0 and np.all(np.diag(triangle) > 0)
        assert np.all(zero(triangle, 1 if zero is np.triu else -1) == 0)
    with pytest.raises(ValueError, match="axis is reversed"):
        lower_times_rotation(np.diag([1.0, 1.0, -1.0]))


# Imports -----------------------------------------------------------------------------------------

READABLE = [m.NAME for m in FORMATS if hasattr(m, "read")]


@pytest.mark.parametrize("name", [n for n in READABLE if n not in ("px4", "ardupilot", "imu_tk")])
def test_what_is_written_reads_back(name):
    cal = calibration(d=name in ("imucal", "inertiax"))
    kwargs = {"gravity": GRAVITY} if name == "imucal" else {}
    result = export(cal, name, **NOISE.get(name, {}))
    again = by_name(name).read(result.content, **kwargs)
    accel, gyro, temperature = samples()
    expected = [x @ result.frame.T for x in ours(cal, accel, gyro, temperature)]
    agree(ours(again, accel, gyro, temperature), expected, tolerance=1e-12)


def test_imu_tk_files_read_back():
    cal = calibration(d=False)
    result = export(cal, "imu_tk")
    (_, first), (_, second) = result.files
    accel, gyro, temperature = samples()
    expected = [x @ result.frame.T for x in ours(cal, accel, gyro, temperature)]
    read = by_name("imu_tk").read
    agree(ours(read(first), accel, gyro, temperature)[:1], expected[:1], tolerance=1e-12)
    found = ours(read(second, kind="gyro"), accel, gyro, temperature)[1:]
    agree(found, expected[1:], tolerance=1e-12)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
@pytest.mark.parametrize("basis", [Constant(), Polynomial(3, LOW, HIGH)], ids=["constant", "cubic"])
def test_parameter_files_read_back(name, basis):
    cal = without_gyro_scale(calibration(basis, diagonal=True))
    cal = constant_scale(cal) if basis.size > 1 else cal
    again = by_name(name).read(export(cal, name).content)
    accel, gyro, temperature = samples()
    agree(
        ours(again, accel, gyro, temperature),
        ours(cal, accel, gyro, temperature),
        tolerance=3e-7,
    )
    assert again.temperature_range == cal.temperature_range


def test_a_thermal_azure_file_reads_back_to_a_hundredth_of_what_it_lost():
    cal = calibration(Polynomial(3, LOW, HIGH), d=False)
    content = export(cal, "azure").content
    again = by_name("azure").read(content)
    accel, gyro, temperature = samples()
    for kind, raw, found in zip(
        ("accel", "gyro"), (accel, gyro), ours(again, accel, gyro, temperature), strict=True
    ):
        expected = azure_apply(content, kind, raw, temperature)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    assert again.temperature_range == (LOW, HIGH)


def test_imported_files_say_that_uncertainties_are_unknown():
    again = by_name("basalt").read(
        export(calibration(d=False), "basalt", **NOISE["basalt"]).content
    )
    assert "uncertainties" in again.notes[0]


def test_named_effects_are_told_as_lost_with_the_lever_arms_size():
    arms = np.array(
        [[0.03, 0.02, 0.04], [0.03, 0.02, 0.01], [0.03, 0.02, 0.01]]
    )  # from the table's axes
    effects = tuple(
        FittedEffect("size_effect", "accel", (k,), (), arms[k], 1e-8 * np.eye(3), "m")
        for k in range(3)
    )
    known = dataclasses.replace(calibration(), effects=effects)
    (lost,) = [line for line in export(known, "c").losses if "effects" in line]
    assert "size_effect on accel_x" in lost and "accel_y" not in lost
    arm = np.array([0.0, 0.0, 0.03])  # of x from the device's own place
    # By search over directions: the greatest first component of w x (w x r) at 1 rad/s.
    w = np.random.default_rng(0).normal(size=(200_000, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    greatest = np.max(np.abs(np.cross(w, np.cross(w, arm))[:, 0]))
    assert f"up to {greatest:.2g} m/s²" in lost
    assert not any("effects" in line for line in export(known, "inertiax").losses)
    assert not any("effects" in line for line in export(calibration(), "c").losses)
