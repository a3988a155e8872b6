"""Do intervals of misalignments cover, where a table is out of level, its axes are out of square, and stand?

    python benchmarks/table_coverage.py [DEVICES]

A table with a horizontal outer axis and an inner one that it carries: 24 positions, then a staircase of rates about
each axis. Base and axes err by angles that are drawn once for a device; each axis has an error of three angles, drawn
anew when it is moved, of half of a positioning's variance, or both are drawn anew for each position. All are turned by
SciPy's rotations, to all orders. Each device is estimated with all that the station states, without level and right
angle, and without what the axes are (positions then err independently).
"""

import sys

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Rig
from inertiax.estimators import ReferenceAccel, ReferenceGyro
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.rig_errors import with_rig_errors


jax.config.update("jax_enable_x64", True)

ARCSEC = np.deg2rad(1.0 / 3600.0)
LEVEL, ORTHOGONALITY, POSITION = 10.0 * ARCSEC, 6.0 * ARCSEC, 4.0 * ARCSEC
FORCE_NOISE, RATE_NOISE = 2e-5, 2e-7  # m/s², rad/s: of a dwell's mean
UP = np.array([0.0, 0.0, 9.81])  # in the room: north, west, up
EARTH = 7.292115e-5 * np.array([np.cos(0.84), 0.0, np.sin(0.84)])
OUTER = np.array([np.cos(0.3), np.sin(0.3), 0.0])  # horizontal, 17° from north
CASE = Rotation.from_euler("zyx", [0.2, 0.1, -0.3])  # of the device on the table
AXES = (tuple(OUTER), tuple(CASE.apply([0.0, 0.0, 1.0], inverse=True)))
STATED = Rig(POSITION, level_uncertainty=LEVEL, orthogonality_uncertainty=ORTHOGONALITY, axes=AXES)
UNSTATED = Rig(POSITION, axes=AXES)
POSITIONS = [(a, b) for b in (0, 90, 180, 270) for a in (0, 90, 180, 270)]
POSITIONS += [
    (45, 0),
    (135, 90),
    (225, 180),
    (315, 270),
    (45, 45),
    (135, 135),
    (225, 225),
    (315, 315),
]
RATES = np.deg2rad([20.0, -20.0, 100.0, -100.0])
# Angles of the axes at a rest, and which of them then turns: about the inner axis upright and level, about the outer
PLATEAUS = [((0, 0), "inner"), ((90, 0), "inner"), ((0, 0), "outer"), ((0, 90), "outer")]
MISALIGNMENTS = [4, 5, 6, 8, 9, 10]  # of bias and matrix, row by row


def attitude(outer: np.ndarray, inner: np.ndarray, tilt: np.ndarray, skew: float) -> Rotation:
    """From the case to the room, at angles in rad, of a base that leans by `tilt` and axes off square by `skew`."""
    base = Rotation.from_rotvec([*tilt, 0.0])
    normal = np.cross(OUTER, [0.0, 0.0, 1.0])
    out = Rotation.from_rotvec(np.multiply.outer(outer, OUTER))
    carried = Rotation.from_rotvec(np.multiply.outer(inner, [0.0, 0.0, 1.0]))
    return base * out * Rotation.from_rotvec(skew * normal) * carried * CASE


NO_AXES = Rig(POSITION, level_uncertainty=LEVEL)


def readings(tilt: np.ndarray, skew: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, force and rate that ideal triads read in each dwell; means over a turn at constant rates."""
    position, force, rate = [], [], []

    def rest(outer: float, inner: float) -> None:
        turned = attitude(np.deg2rad(outer), np.deg2rad(inner), tilt, skew)
        position.append(len(position))
        force.append(turned.apply(UP, inverse=True))
        rate.append(turned.apply(EARTH, inverse=True))

    for outer, inner in POSITIONS:
        rest(outer, inner)
    turn = 2.0 * np.pi * np.arange(90) / 90
    for angles, which in PLATEAUS:
        rest(*angles)
        outer, inner = (np.full(90, np.deg2rad(a)) for a in angles)
        outer, inner = (outer + turn, inner) if which == "outer" else (outer, inner + turn)
        turned = attitude(outer, inner, tilt, skew)
        # The inner axis as the case carries it; the outer one as base and case see it.
        about = np.tile(AXES[1], (90, 1))
        if which == "outer":
            leaning = Rotation.from_rotvec([*tilt, 0.0]).apply(OUTER)
            about = turned.apply(np.tile(leaning, (90, 1)), inverse=True)
        for speed in RATES:
            position.append(-1)
            force.append(turned.apply(np.tile(UP, (90, 1)), inverse=True).mean(axis=0))
            rate.append(
                (turned.apply(np.tile(EARTH, (90, 1)), inverse=True) + speed * about).mean(axis=0)
            )
    return np.array(position), np.array(force), np.array(rate)


PLAN = readings(np.zeros(2), 0.0)


def positioning(rng: np.random.Generator, stand: bool) -> Rotation:
    """How the case is turned against its reference in each dwell; where axes `stand`, by errors that they keep."""
    anew = lambda size: size * rng.standard_normal(3)
    made, last, error = [], (None, None), [np.zeros(3), np.zeros(3)]
    rests = iter([*POSITIONS, *(angles for angles, _ in PLATEAUS)])
    staircase = Rotation.identity()
    for k, position in enumerate(PLAN[0]):
        if position >= 0:
            angles = next(rests)
            for axis in range(2):
                if not stand or angles[axis] != last[axis]:
                    error[axis] = anew(np.sqrt(0.5) * POSITION)
            last = angles
            case = attitude(*np.deg2rad(angles), np.zeros(2), 0.0)
            seen = Rotation.from_rotvec(case.apply(error[0], inverse=True))
            made.append(seen * Rotation.from_rotvec(error[1]))
            own = Rotation.from_rotvec(anew(POSITION))
            staircase = own if stand else made[-1]  # or the plateaus follow their rest
        else:
            made.append(staircase)
            turned = PLATEAUS[[j for j, _ in enumerate(PLATEAUS) if j * 5 + 24 < k][-1]][1]
            last = (None, last[1]) if turned == "outer" else (last[0], None)
    return Rotation.concatenate(made)


def drawn(rng: np.random.Generator, stand: bool = False) -> tuple[Dwells, np.ndarray, np.ndarray]:
    """One device on one table: its dwells, and the true matrices of its triads."""
    _, force, rate = readings(LEVEL * rng.standard_normal(2), ORTHOGONALITY * rng.standard_normal())
    turned = positioning(rng, stand)
    matrices = 1e-3 * rng.standard_normal((2, 3, 3))
    seen = []
    for truth, matrix, noise in zip(
        (force, rate), matrices, (FORCE_NOISE, RATE_NOISE), strict=True
    ):
        clean = turned.apply(truth) @ (np.eye(3) + matrix).T
        seen.append(clean + noise * rng.standard_normal(clean.shape))
    dwells = Dwells.from_arrays(
        *seen, position=PLAN[0], reference_accel=PLAN[1], reference_gyro=PLAN[2],
        sigma=(FORCE_NOISE, RATE_NOISE),
    )  # fmt: skip
    return jax.tree.map(np.asarray, dwells), *matrices


def deviations(device: tuple[Dwells, np.ndarray, np.ndarray], rig: Rig) -> np.ndarray:
    """Misalignments of the accelerometers, then of the gyros, in standard deviations from the truth."""
    made, (dwells, *matrices) = [], device
    dwells = with_rig_errors(dwells, rig)
    for estimator, truth in zip(
        (ReferenceAccel(), ReferenceGyro(gravity=9.81)), matrices, strict=True
    ):
        found = joint_fit_one(estimator, Constant(), dwells)
        off = np.asarray(found.curve.coefficients)[0, 3:12] - truth.ravel()
        z = off / np.sqrt(np.diagonal(np.asarray(found.covariance)))[3:12]
        made.append(z[[k - 3 for k in MISALIGNMENTS]])
    return np.stack(made)


def line(values: list[np.ndarray]) -> str:
    """Share within 95 % intervals, and the root mean square."""
    z = np.concatenate(values)
    return f"{100 * np.mean(np.abs(z) < 1.96):.1f} % (rms {np.sqrt(np.mean(np.square(z))):.2f})"


def main(devices: int = 1000) -> None:
    """Print the table."""
    rng = np.random.default_rng(1)
    print("| positions | misalignments of | stated | level and right angle not | axes not |")
    print("|---|---|---|---|---|")
    for stand, words in ((True, "errors of axes that stand"), (False, "drawn anew")):
        made = [drawn(rng, stand) for _ in range(devices)]
        found = [[deviations(d, rig) for d in made] for rig in (STATED, UNSTATED, NO_AXES)]
        for k, triad in enumerate(("accelerometers", "gyros")):
            cells = " | ".join(line([z[k] for z in values]) for values in found)
            print(f"| {words} | {triad} | {cells} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
