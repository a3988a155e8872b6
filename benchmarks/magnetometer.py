"""Magnetometers: are the stated uncertainties right, and does a public log agree with a fit by SciPy?

    INERTIAX_RECORDINGS=… python benchmarks/magnetometer.py

First, simulated campaigns whose truth is known (`tests/magnetometer_cases.py`), 240 of each kind: normalised errors of
every parameter have unit variance, χ² over its degrees of freedom is 1, and 95 % intervals hold the truth in 95 %.

Second, the slow full sphere by hand of `sunsided-mpu6050` (an HMC5883L beside an MPU-6050): the estimate from samples
that are thinned to one per five degrees of turn, beside SciPy's Levenberg-Marquardt over all samples, which is what
`magcal` of MATLAB and its kin do: an ellipsoid by its geometric distance, without weights. Both in the triad's own
frame, at the same conventional field.
"""

import os
import sys
import time
from pathlib import Path

import h5py
import jax
import numpy as np
import scipy.optimize

from inertiax.calibrate.magnetometers import calibrate_magnetometers
from inertiax.calibrate.results import MagnetometerResult
from inertiax.data.recording import Recording
from inertiax.reduction.field_rows import field_rows


sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from magnetometer_cases import DIP, DRIFT, FIELD, HARD, rows, SOFT, WARM, WIRE  # noqa: E402


jax.config.update("jax_enable_x64", True)


RUNS = 240
KINDS: dict[str, dict] = {
    "24 rests alone": {"rests": 24, "moving": 0},
    "20 rests and 40 samples in motion": {"rests": 20, "moving": 40},
    "the same, hard iron over 50 °C": {"rests": 20, "moving": 40, "warm": True, "drift": DRIFT},
    "the same, beside up to 20 A": {"rests": 20, "moving": 40, "driven": True, "wire": WIRE},
    "20 rests, 300 samples of slow turns, uneven field": {
        "rests": 20,
        "moving": 300,
        "uneven": 2e-7,
    },
}
STEP = 1e-6  # T, scale of the peer's unknowns and residuals


def truth_of(kind: dict, found: MagnetometerResult) -> np.ndarray:
    """The coefficients that the simulation has, in the basis of the estimate."""
    wire = [WIRE] if kind.get("driven") else []
    constant = np.concatenate([HARD, SOFT.ravel(), *wire, [-FIELD * np.sin(DIP)]])
    truth = np.zeros(found.free.shape)
    truth[0] = constant
    if kind.get("warm") and len(truth) > 1:
        low, high = float(found.curve.basis.low), float(found.curve.basis.high)
        truth[0, :3] += DRIFT * (0.5 * (low + high) - WARM)
        truth[1, :3] = DRIFT * 0.5 * (high - low)
    return truth


def simulated() -> None:
    """Unit variance over many runs of each kind."""
    print(
        "| campaign | runs | χ² over dof | in 95 % | worst σ of a parameter | more or fewer terms |"
    )
    print("|---|---|---|---|---|---|")
    for name, kind in KINDS.items():
        chi2, scores, other = [], [], 0
        for seed in range(RUNS):
            found = calibrate_magnetometers(rows(seed, **kind), field=FIELD)
            own = np.flatnonzero(found.free.ravel())
            wanted = len(truth_of(kind, found)[0]) + (3 if kind.get("warm") else 0)
            if len(own) != wanted:
                other += 1  # BIC takes another degree by chance; the errors are judged all the same
            error = (np.asarray(found.curve.coefficients) - truth_of(kind, found)).ravel()[own]
            spread = np.asarray(found.covariance)[np.ix_(own, own)]
            chi2.append(error @ np.linalg.solve(spread, error) / len(own))
            if len(own) == wanted:
                scores.append(error / np.sqrt(np.diagonal(spread)))
        inside = np.mean(np.abs(np.array(scores)) < 1.96)
        sizes = np.array(scores).std(axis=0)
        worst = sizes[np.argmax(np.abs(sizes - 1.0))]
        print(
            f"| {name} | {RUNS} | {np.mean(chi2):.3f} | {100 * inside:.1f} % | {worst:.2f} | {other} |"
        )


def ellipsoid(outputs: np.ndarray, field: float) -> tuple[np.ndarray, np.ndarray]:
    """Hard iron and lower-triangular E + S by SciPy, of the magnitude's distance from `field`."""
    lower = np.tril_indices(3)

    def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        product = np.zeros((3, 3))
        product[lower] = x[3:]
        return STEP * x[:3], product

    def misfit(x: np.ndarray) -> np.ndarray:
        hard, product = parts(x)
        compensated = np.linalg.solve(product, (outputs - hard).T)
        return (np.linalg.norm(compensated, axis=0) - field) / STEP

    middle = 0.5 * (outputs.min(axis=0) + outputs.max(axis=0))
    start = np.concatenate([middle / STEP, np.eye(3)[lower]])
    found = scipy.optimize.least_squares(misfit, start, method="lm", xtol=1e-14, ftol=1e-14)
    return parts(found.x)


def public(folder: Path) -> None:
    """A log by hand beside SciPy."""
    with h5py.File(folder / "full-sphere" / "hmc5883l_compass.mat") as file:
        stored = np.array(file["compassBuffer"], float).T
    outputs = 1e-4 * stored[:, 1:]  # gauss
    recording = Recording.from_arrays(mag=outputs, time=stored[:, 0])
    begun = time.process_time()
    found = calibrate_magnetometers(field_rows((recording,), None))
    took = time.process_time() - begun
    field = float(np.asarray(found.estimator.field))
    lower = np.tril_indices(3)
    ours = np.asarray(found.curve.coefficients)[0]
    sigma = np.sqrt(np.diagonal(np.asarray(found.covariance)))
    print(*found.statements, sep="\n")
    print(
        f"τ {float(np.asarray(found.estimator.alike)):.1f} samples in motion tell what one does; {took:.1f} s of CPU"
    )
    used = np.asarray(found.dwells.mag)
    peers = {"all samples": ellipsoid(outputs, field), "the same samples": ellipsoid(used, field)}
    print("| | " + " | ".join(["inertiax", "± 1 σ", *(f"SciPy, {p}" for p in peers)]) + " |")
    print("|---|---|---|---|---|")
    for k, axis in enumerate("xyz"):
        cells = [f"{1e6 * hard[k]:.3f}" for hard, _ in peers.values()]
        print(
            f"| hard iron {axis}, µT | {1e6 * ours[k]:.3f} | {1e6 * sigma[k]:.3f} | {' | '.join(cells)} |"
        )
    for i, j in zip(*lower, strict=True):
        at = 3 + 3 * i + j
        cells = [f"{product[i, j] - (i == j):.5f}" for _, product in peers.values()]
        print(
            f"| soft iron {'xyz'[i]}{'xyz'[j]} | {ours[at]:.5f} | {sigma[at]:.5f} | {' | '.join(cells)} |"
        )
    sigma[sigma == 0.0] = np.inf  # the elements above the diagonal, which the frame holds at zero
    for name, (hard, product) in peers.items():
        scale = np.cbrt(np.linalg.det(product))  # the convention: the mean scale is one
        apart = [*(ours[:3] - hard) / sigma[:3]]
        own = (ours[3:12].reshape(3, 3) + np.eye(3) - product / scale) / sigma[3:12].reshape(3, 3)
        apart += [own[i, j] for i, j in zip(*lower, strict=True)]
        print(f"{name}: apart by at most {np.max(np.abs(apart)):.2f} of our σ")


def main() -> None:
    """Both parts; the second where the recordings are."""
    begun = time.process_time()
    simulated()
    print(f"{time.process_time() - begun:.0f} s of CPU")
    folder = os.environ.get("INERTIAX_RECORDINGS")
    if folder is None:
        print("INERTIAX_RECORDINGS is not set: no public log.")
        return
    public(Path(folder) / "sunsided-mpu6050")


if __name__ == "__main__":
    main()
