"""A magnetometer triad beside accelerometers in one place, simulated in NumPy by its own formulas."""

import numpy as np

from inertiax.reduction.dwells import Dwells


FIELD, DIP = (
    48e-6,
    np.radians(64.0),
)  # T and rad below the horizontal, about those of central Europe
HARD = np.array([20e-6, -35e-6, 12e-6])  # T
SOFT = np.array([[0.05, 0.02, -0.03], [-0.01, -0.04, 0.015], [0.02, 0.01, 0.03]])
WIRE = np.array([0.2e-6, -0.1e-6, 0.15e-6])  # T/A
DRIFT = np.array([1e-6, -2e-6, 0.5e-6]) / 25.0  # T/°C
WARM = 25.0  # °C, where `HARD` holds


def rotations(count, rng):
    """Rotations from the room (x north, z up) to the device, evenly spread (Shoemake 1992)."""
    w, x, y, z = (q := rng.normal(size=(4, count))) / np.linalg.norm(q, axis=0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def slow_turns(count, rng, step=0.1):
    """Rotations that follow each other by `step` (rad) about axes that wander."""
    turn, axis, found = rotations(1, rng)[0], rng.normal(size=3), []
    for _ in range(count):
        axis = 0.9 * axis + rng.normal(size=3)
        x, y, z = axis / np.linalg.norm(axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rodrigues = np.eye(3) + np.sin(step) * cross + (1.0 - np.cos(step)) * cross @ cross
        turn = rodrigues @ turn
        found.append(turn)
    return np.array(found).reshape(-1, 3, 3)


def field_of(turns):
    """The field in the device's frame, T."""
    return turns @ (FIELD * np.array([np.cos(DIP), 0.0, -np.sin(DIP)]))


def rows(
    seed,
    rests=30,
    moving=60,
    *,
    noise=5e-8,
    tilt=1e-3,
    soft=SOFT,
    drift=0.0,
    wire=0.0,
    warm=False,
    driven=False,
    uneven=0.0,
):
    """Rests and samples in motion with 1 sigma of `noise` (T) and `tilt` (m/s²) on each output.

    `uneven` is 1 sigma (T) of what the place adds to the field on each axis; samples in motion then turn slowly, with
    a memory of the place over five of them.
    """
    rng = np.random.default_rng(seed)
    count = rests + moving
    turns = rotations(count, rng)
    temperature = rng.uniform(0.0, 50.0, count) if warm else np.full(count, WARM)
    current = rng.uniform(0.0, 20.0, count) if driven else None
    if uneven:
        turns = np.concatenate([turns[:rests], slow_turns(moving, rng)])
    field = field_of(turns)
    if uneven:
        place, memory = rng.normal(size=(count, 3)), np.exp(-1.0 / 5.0)
        for k in range(rests + 1, count):  # rests are each in a place of their own
            place[k] = memory * place[k - 1] + np.sqrt(1.0 - memory**2) * place[k]
        field = field + uneven * place
    mag = field @ (np.eye(3) + soft).T + HARD
    mag = mag + drift * (temperature - WARM)[:, None]
    mag = mag + (0.0 if current is None else np.multiply.outer(current, wire))
    force = 9.81 * turns[:, :, 2] + tilt * rng.normal(size=(count, 3))
    spread = lambda sigma: np.tile(sigma**2 * np.eye(3), (count, 1, 1))
    return Dwells(
        time=np.arange(count, dtype=float),
        duration=np.where(np.arange(count) < rests, 1.0, 0.0),
        count=np.ones(count),
        temperature=temperature,
        experiment=np.zeros(count, int),
        position=np.where(np.arange(count) < rests, np.arange(count), -1),
        valid=np.ones(count, bool),
        accel=force,
        accel_covariance=spread(max(tilt, 1e-9)),
        mag=mag + noise * rng.normal(size=(count, 3)),
        mag_covariance=spread(max(noise, 1e-12)),
        current=current,
    )
