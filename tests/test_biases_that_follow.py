"""A log by hand that warms up: biases that follow temperature where the poses do not tell so of every parameter."""

from functools import cache

import numpy as np

import inertiax as ix
from inertiax.calibrate.pipeline import calibrate


BIAS, SLOPE = np.array([0.1, -0.2, 0.05]), np.array([4e-3, -3e-3, 5e-3])  # m/s² at 20 °C, m/s²/°C


@cache
def calibrated(slope: float, degree: int | None = None, poses: int = 24, warm_up: float = 15.0):
    """Rests in `poses` attitudes, 8 to 30 °C as 1 − exp(−t / `warm_up`), three of them cold where that is 15 s."""
    rng = np.random.default_rng(0)
    up = rng.standard_normal((poses, 3))
    up = np.repeat(9.81 * up / np.linalg.norm(up, axis=1)[:, None], 200, axis=0)
    time = np.arange(len(up)) / 50.0
    temperature = 30.0 - 22.0 * np.exp(-time / warm_up)
    accel = (
        1.005 * up
        + BIAS
        + slope * SLOPE * (temperature[:, None] - 20.0)
        + 0.02 * rng.standard_normal(up.shape)
    )
    recording = ix.Recording.from_arrays(time, accel, temperature=temperature)
    model = ix.ModelChoice(temperature_degree=degree)
    (result,) = calibrate(ix.Campaign(recording, ix.Site(gravity=9.81), model=model))
    return result


def test_constants_that_biases_do_not_keep_to_are_doubted_and_the_way_out_is_right():
    """A mean of 200 samples is known to 0.0014 m/s²; over 22 °C the biases move by 0.07 to 0.11."""
    result = calibrated(1.0)
    assert result.calibration.accel.curve.basis.size == 1
    (said,) = [w for w in result.warnings if "biases follow temperature" in w]
    assert said.startswith("accel: ") and "8 to 30 °C" in said and "temperature_degree=1" in said
    calibration = calibrated(1.0, 1).calibration.conditioned("*.matrix.c1")
    basis = calibration.accel.curve.basis
    middle, half = 0.5 * (basis.high + basis.low), 0.5 * (basis.high - basis.low)
    for pattern, truth in (
        ("*.bias.c0", BIAS + SLOPE * (middle - 20.0)),
        ("*.bias.c1", SLOPE * half),
    ):
        block = calibration.block(pattern)
        sigma = np.sqrt(np.diag(block.covariance))
        assert (abs(block.mean - truth) < 4.0 * sigma).all() and (
            sigma < 0.1 * abs(SLOPE * half)
        ).all()
    assert not any("biases follow" in w for w in calibrated(1.0, 1).warnings)
    # Degree 1 has 18 unknowns, and asking for it is refused below 21 equations.
    (said,) = [
        w
        for w in calibrated(1.0, poses=19, warm_up=60.0).warnings
        if "biases follow temperature" in w
    ]
    assert said.endswith("the same cold and warm")
    assert (
        "nothing is left to judge the fit by" in calibrated(1.0, 1, poses=19, warm_up=60.0).reason
    )


def test_constants_that_biases_keep_to_are_not_doubted():
    result = calibrated(0.0)
    assert result.calibration.accel.curve.basis.size == 1
    assert not any("biases follow" in w for w in result.warnings)
