"""A thousand devices: from arrays to calibrations, and their sensitivities, timed; one of them against Monte Carlo.

    python benchmarks/sensitivity_devices.py [--devices 1000] [--runs 10000]

Each device has 24 rests for its accelerometers, whose directions are not known (|a| = g), and as many known rates for
its gyros: 21 coefficients. Sensitivities are by gravity and by noise, of both triads and of the accelerometers alone (9
coefficients). Times are of the processor (all threads together) and of the clock, the least of three, compilation left
out.
In the Monte Carlo the outputs of one
device's accelerometers are drawn anew `--runs` times with noise and fitted; the standard deviations are compared with
those of `ix.derivatives`.
"""

import argparse
import time
from collections.abc import Callable

import jax
import numpy as np

import inertiax as ix


GRAVITY, DWELLS, SIGMA = 9.81, 24, 1e-4
ESTIMATOR = ix.Invariant(gravity=GRAVITY)
NOISE = (ix.sources.output_noise(),)
SOURCES = (ix.sources.gravity(1e-4), *NOISE)


def rests(devices: int) -> np.ndarray:
    """Outputs of devices with biases and lower-triangular matrices of their own, m/s²."""
    random = np.random.default_rng(5)
    up = random.normal(size=(devices, DWELLS, 3))
    up *= GRAVITY / np.linalg.norm(up, axis=-1, keepdims=True)
    bias = 0.05 * random.normal(size=(devices, 1, 3))
    matrix = 1e-3 * np.tril(random.normal(size=(devices, 3, 3)))
    return up + np.einsum("nij,ndj->ndi", matrix, up) + bias


def least(run: Callable[[], object]) -> tuple[float, float]:
    """Processor and wall time of the quickest of three runs after a first, s."""
    run()
    found = []
    for _ in range(3):
        before = time.process_time(), time.perf_counter()
        jax.block_until_ready(run())
        found.append((time.process_time() - before[0], time.perf_counter() - before[1]))
    return min(f[0] for f in found), min(f[1] for f in found)


def calibrations(accel: np.ndarray) -> ix.Fit:
    """Arrays to a calibration each."""
    dwells = ix.Dwells.from_arrays(accel, sigma=SIGMA)
    return ix.fit(dwells, accel=ESTIMATOR)


def both(accel: np.ndarray, gyro: np.ndarray, rate: np.ndarray) -> ix.Fit:
    """The same with gyros."""
    # A table that turns so slowly that its accelerometers are as good as at rest.
    dwells = ix.Dwells.from_arrays(
        accel, gyro, reference_gyro=rate, sigma=(SIGMA, 1e-5), position=np.arange(accel.shape[-2])
    )
    return ix.fit(dwells, accel=ESTIMATOR, gyro=ix.ReferenceGyro(gravity=GRAVITY))


def main() -> None:
    """Print times a device, and the worst ratio of deviations."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=10_000)
    given = parser.parse_args()
    clean = rests(given.devices)
    random = np.random.default_rng(6)
    noisy = clean + SIGMA * random.normal(size=clean.shape)
    rate = random.normal(size=clean.shape)
    gyro = 1.01 * rate + 0.02 + 1e-5 * random.normal(size=rate.shape)
    processor, wall = least(lambda: both(noisy, gyro, rate))
    per = 1e3 / given.devices
    print(f"fit: {per * processor:.3f} ms of processor a device, {per * wall:.3f} ms of the clock")
    whole = both(noisy, gyro, rate)
    processor, wall = least(lambda: ix.derivatives(whole, SOURCES))
    print(f"derivatives, both triads: {per * processor:.3f} ms, {per * wall:.3f} ms of the clock")
    fit = calibrations(noisy)
    processor, wall = least(lambda: ix.derivatives(fit, SOURCES))
    print(f"accelerometers alone: {per * processor:.3f} ms, {per * wall:.3f} ms of the clock")
    mapped = jax.jit(jax.vmap(lambda f: ix.derivatives(f, SOURCES)))
    with jax.enable_x64(True):
        processor, wall = least(lambda: mapped(fit))
    print(f"the same under vmap: {per * processor:.3f} ms, {per * wall:.3f} ms of the clock")

    one = calibrations(clean[:1])
    table = ix.derivatives(one, NOISE)
    draws = clean[0] + SIGMA * random.normal(size=(given.runs, DWELLS, 3))
    coefficients = np.concatenate(
        [np.asarray(calibrations(d).calibration.coefficients) for d in np.array_split(draws, 10)]
    )
    ratio = coefficients.std(axis=0) / np.asarray(table.sigma)[0, 0]
    print(
        f"outputs' noise, {given.runs} runs: Monte Carlo/derivatives from {ratio.min():.3f} to {ratio.max():.3f} "
        f"(one sigma of a deviation is {1 / np.sqrt(2 * given.runs):.4f})"
    )


if __name__ == "__main__":
    main()
