"""The C header and the StableHLO program compute what our compensation does."""

import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import interpolate

from exports_cases import agree, calibration, GRAVITY, HIGH, LOW, ours, samples, triad
from inertiax.calibration.calibration import Calibration
from inertiax.calibration.magnetometers import MagnetometerCalibration
from inertiax.calibration.triad import TriadCalibration
from inertiax.exports import export, measure_loss
from inertiax.physics.temperature import Constant, CubicSpline, Curve, Polynomial


MAIN = """
#include <stdio.h>
#include "imu.h"
int main(void)
{
    double v[7];
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", v, v+1, v+2, v+3, v+4, v+5, v+6) == 7) {
        REAL a[3], w[3], f[3], r[3];
        for (int k = 0; k < 3; k++) { a[k] = (REAL)v[k]; w[k] = (REAL)v[3 + k]; }
        imu_compensate(a, w, (REAL)v[6], f, r);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\\n", f[0], f[1], f[2], r[0], r[1], r[2]);
    }
    return 0;
}
"""

MAG_MAIN = """
#include <stdio.h>
#include "imu.h"
int main(void)
{
    double v[5];
    while (scanf("%lf %lf %lf %lf %lf", v, v+1, v+2, v+3, v+4) == 5) {
        REAL m[3], b[3];
        for (int k = 0; k < 3; k++) m[k] = (REAL)v[k];
        imu_compensate_mag(m, (REAL)v[3], (REAL)v[4], b);
        printf("%.17g %.17g %.17g\\n", b[0], b[1], b[2]);
    }
    return 0;
}
"""

BASES = [
    Constant(),
    Polynomial(1, LOW, HIGH),
    Polynomial(6, LOW, HIGH),
    CubicSpline((LOW, -10.0, 25.0, HIGH)),
    CubicSpline((LOW, HIGH)),
]


def run_header(folder, text, real, accel, gyro, temperature):
    out = compiled(folder, text, MAIN, real, np.column_stack([accel, gyro, temperature]))
    return out[:, :3], out[:, 3:]


def compiled(folder, text, main, real, rows):
    (folder / "imu.h").write_text(text)
    (folder / "main.c").write_text(main)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", f"-DREAL={real}"]
    # Fused multiply-adds would not be a failure of the header, but of the comparison's tolerance.
    flags.append("-ffp-contract=off")
    subprocess.run(["cc", *flags, "main.c", "-o", "main"], cwd=folder, check=True, timeout=60)
    text = "\n".join(" ".join(map(repr, r)) for r in rows.tolist())
    done = subprocess.run(
        [str(folder / "main")], input=text, capture_output=True, text=True, check=True, timeout=60
    )
    return np.array([line.split() for line in done.stdout.splitlines()], float)


@pytest.mark.parametrize("basis", BASES, ids=lambda b: f"{type(b).__name__} of {b.size}")
def test_compiled_header_equals_our_compensation_to_1e_12(tmp_path, basis):
    cal = calibration(basis)
    accel, gyro, temperature = samples()
    temperature[:2] = LOW - 15.0, HIGH + 15.0  # beyond the range the curves go on alike
    text = export(cal, "c").content.decode()
    found = run_header(tmp_path, text, "double", accel, gyro, temperature)
    for a, b in zip(found, ours(cal, accel, gyro, temperature), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


@pytest.mark.parametrize("basis", BASES[2:4], ids=lambda b: type(b).__name__)
def test_compiled_header_in_single_precision(tmp_path, basis):
    cal = calibration(basis)
    accel, gyro, temperature = samples()
    text = export(cal, "c", dtype="float32", name="imu").content.decode()
    assert "double" not in text
    found = run_header(tmp_path, text, "float", accel, gyro, temperature)
    # Some ten roundings of 6e-8 relative in the solve of a well conditioned matrix.
    agree(found, ours(cal, accel, gyro, temperature), tolerance=2e-6)


def magnetometers(basis):
    """Hard iron, soft iron and a current's field that move with temperature, and their parameters anew in NumPy."""
    names = [f"mag.bias[{i}]" for i in range(3)]
    names += [f"mag.matrix[{i},{j}]" for i in range(3) for j in range(3)]
    names += [f"mag.current[{i}]" for i in range(3)]
    rng = np.random.default_rng(6)
    size = np.repeat([2e-5, 0.05, 2e-7], [3, 9, 3])
    values = rng.standard_normal((basis.size, 15)) * size / 4.0 ** np.arange(basis.size)[:, None]
    triad = TriadCalibration(
        Curve(basis, jnp.asarray(values)), jnp.zeros((values.size,) * 2), tuple(names), "field"
    )
    span = None if isinstance(basis, Constant) else (LOW, HIGH)
    mag = MagnetometerCalibration(triad, 48e-6)
    return Calibration(gravity=GRAVITY, mag=mag, temperature_range=span), values


def parameters_of(basis, values, temperature):
    """By NumPy's Chebyshev series and SciPy's natural spline."""
    if isinstance(basis, Polynomial):
        x = (2.0 * temperature - LOW - HIGH) / (HIGH - LOW)
        return np.polynomial.chebyshev.chebval(x, values).T
    if isinstance(basis, CubicSpline):
        return interpolate.CubicSpline(np.asarray(basis.knots), values, bc_type="natural")(
            temperature
        )
    return np.repeat(values, len(temperature), axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("basis", BASES[:4], ids=lambda b: f"{type(b).__name__} of {b.size}")
def test_compiled_header_gives_the_magnetometers_field(tmp_path, basis, real):
    cal, values = magnetometers(basis)
    rng = np.random.default_rng(7)
    field = 5e-5 * rng.standard_normal((100, 3))
    temperature, current = rng.uniform(LOW, HIGH, 100), rng.uniform(0.0, 30.0, 100)
    p = parameters_of(basis, values, temperature)
    matrix = np.eye(3) + p[:, 3:12].reshape(-1, 3, 3)
    outputs = np.einsum("tij,tj->ti", matrix, field) + p[:, :3] + p[:, 12:] * current[:, None]
    dtype = "float32" if real == "float" else "float64"
    text = export(cal, "c", dtype=dtype).content.decode()
    rows = np.column_stack([outputs, temperature, current])
    found = compiled(tmp_path, text, MAG_MAIN, real, rows)
    # The same roundings as of the accelerometers, relative to the outputs.
    np.testing.assert_allclose(
        found, field, rtol=0, atol=(2e-6 if real == "float" else 1e-12) * 1e-4
    )
    ours_ = jax.vmap(cal.mag)(*map(jnp.asarray, (outputs, temperature, current)))
    np.testing.assert_allclose(ours_, field, rtol=0, atol=1e-16)  # `compensate` does the same
    assert measure_loss(cal, export(cal, "c")).field.vector < 1e-12 * 48e-6


def test_a_header_says_what_becomes_of_other_temperatures_and_holds_no_triad_that_is_none():
    text = export(calibration(Polynomial(3, LOW, HIGH)), "c", name="unit").content.decode()
    assert "outside of UNIT_LOW to UNIT_HIGH the curves go on" in text
    assert "mag" not in text.split("#ifndef")[1]


def test_a_header_of_one_triad_leaves_the_other_as_it_is(tmp_path):
    cal = Calibration(gravity=GRAVITY, accel=triad("accel", Constant()))
    accel, gyro, temperature = samples()
    text = export(cal, "c").content.decode()
    force, rate = run_header(tmp_path, text, "double", accel, gyro, temperature)
    np.testing.assert_array_equal(rate, gyro)
    agree([force], [ours(cal, accel, gyro, temperature)[0]])


def test_a_device_name_cannot_leave_the_headers_comment():
    cal = calibration(device='*/ int evil; /* "')
    text = export(cal, "c").content.decode()
    assert "*/ int evil" not in text and "int evil" in text.splitlines()[0]


@pytest.mark.slow
def test_a_precision_that_is_none_is_told_which_there_are():
    with pytest.raises(ValueError, match="dtype = 'double': it is one of float32, float64"):
        export(calibration(), "c", dtype="double")


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_reloaded_stablehlo_equals_our_compensation(dtype):
    pytest.importorskip("flatbuffers", reason="flatbuffers is not installed")
    import jax.export

    cal = calibration(Polynomial(4, LOW, HIGH))
    content = export(cal, "stablehlo", dtype=dtype).content
    program = jax.export.deserialize(bytearray(content))
    for count in (1, 57):  # any number of samples
        accel, gyro, temperature = samples(count)
        force, rate = program.call(*(jnp.asarray(x, dtype) for x in (accel, gyro, temperature)))
        assert force.dtype == rate.dtype == dtype
        tolerance = 2e-13 if dtype == "float64" else 2e-6
        agree((force, rate), ours(cal, accel, gyro, temperature), tolerance)
