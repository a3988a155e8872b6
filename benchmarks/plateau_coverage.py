"""Do intervals of misalignments cover, where a table's position error is drawn for an axis or for each plateau?

    python benchmarks/plateau_coverage.py [DEVICES]

A staircase of rates about each case axis at three temperatures, in dwell means. The positions' error is drawn once for
the axis and temperature, as a table has it that is set and then turns, or anew for each plateau. Each draw is estimated
with the error shared by the plateaus of a positioning, as `calibrate` does, and with one for each dwell.
"""

import sys

import equinox as eqx
import jax
import numpy as np

from inertiax.data.recording import Rig
from inertiax.estimators import ReferenceGyro
from inertiax.physics.temperature import Polynomial
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.rig_errors import rig_covariance, with_rig_errors


jax.config.update("jax_enable_x64", True)

ANGLE, RATE = float(np.deg2rad(10.0 / 3600.0)), 2e-5  # 10″, 20 ppm
NOISE = np.deg2rad(5.0 / 3600.0)  # 5 °/h on a plateau's mean
RATES = np.deg2rad([10.0, -10.0, 50.0, -50.0, 200.0, -200.0])
TEMPERATURES = (-20.0, 20.0, 60.0)
RIG = Rig(position_uncertainty=ANGLE, rate_uncertainty=RATE)
BASIS = Polynomial(1, TEMPERATURES[0], TEMPERATURES[-1])
MISALIGNMENTS = [4, 5, 6, 8, 9, 10]  # of bias and matrix, row by row


def drawn(rng: np.random.Generator, *, for_an_axis: bool) -> Dwells:
    """One device without errors of its own."""
    rate = np.array([r * e for _ in TEMPERATURES for e in np.eye(3) for r in RATES])
    count = len(rate)
    angle = ANGLE * rng.standard_normal((count, 3))
    if for_an_axis:
        angle = angle[np.arange(count) // len(RATES)]
    seen = rate * (1.0 + RATE * rng.standard_normal((count, 1))) + np.cross(angle, rate)
    dwells = Dwells.from_arrays(
        gyro=seen + NOISE * rng.standard_normal(rate.shape),
        reference_gyro=rate,
        temperature=np.repeat(TEMPERATURES, count // len(TEMPERATURES)),
        sigma=NOISE,
    )
    return jax.tree.map(np.asarray, dwells)


def of_each_dwell(dwells: Dwells) -> Dwells:
    """The rig's errors in every dwell's own covariance."""
    wider = dwells.gyro_covariance + rig_covariance(np.asarray(dwells.reference_gyro), ANGLE, RATE)
    return eqx.tree_at(lambda d: d.gyro_covariance, dwells, wider)


def deviations(dwells: Dwells) -> np.ndarray:
    """Misalignments at the lowest, middle and highest temperature, in standard deviations."""
    found = joint_fit_one(ReferenceGyro(gravity=9.81), BASIS, dwells)
    coefficients, covariance = np.asarray(found.curve.coefficients), np.asarray(found.covariance)
    phi = BASIS.rows(np.array(TEMPERATURES))
    blocks = covariance.reshape(2, 12, 2, 12)
    variance = np.einsum("ta,aibi,tb->ti", phi, blocks, phi)
    return ((phi @ coefficients) / np.sqrt(variance))[:, MISALIGNMENTS].ravel()


def line(values: list[np.ndarray]) -> str:
    """Share within 95 % intervals, and the root mean square."""
    z = np.concatenate(values)
    return f"{100 * np.mean(np.abs(z) < 1.96):.1f} % (rms {np.sqrt(np.mean(np.square(z))):.2f})"


def main(devices: int = 400) -> None:
    """Print the table."""
    print("| the table's error is drawn | as calibrated | with angles of each plateau's own |")
    print("|---|---|---|")
    for for_an_axis, said in (
        (True, "once for an axis and temperature"),
        (False, "anew for each plateau"),
    ):
        rng = np.random.default_rng(1)
        made = [drawn(rng, for_an_axis=for_an_axis) for _ in range(devices)]
        shared = line([deviations(with_rig_errors(d, RIG)) for d in made])
        own = line([deviations(of_each_dwell(d)) for d in made])
        print(f"| {said} | {shared} | {own} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
