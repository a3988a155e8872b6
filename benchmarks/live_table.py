"""Hours at rest until a target on a table in a chamber: `live` at each temperature, against a D-optimal plan.

Devices are those of `live_hand.py` made better: biases of 3 mg, scale factors of 0.1 %, misalignments of 3' (1 sigma),
other ones at each temperature; white noise of 20 µg in the mean of a minute, 10 µg from one positioning to the next,
each log-normal by a factor of 1.8 (1 sigma). The table holds what it is told exactly, and no rest is refused. Gravity's
magnitude calibrates; the target is 40 µg and 60 ppm at every temperature.

* The plan: 18 D-optimal positions at every temperature, with rests long enough that a device of the noise that 5 % of
  these devices exceed has all errors within their limits with 95 %.
* `live`: rests of 20 s, until it says that the target is reached; the chamber goes on then.

    python benchmarks/live_table.py [--devices 200] [--temperatures 2]
"""

import argparse

import live_hand as hand
import numpy as np

from inertiax.data.recording import Campaign, Rig, Site
from inertiax.design import optimal_positions
from inertiax.estimators import Invariant
from inertiax.live.estimate import estimate
from inertiax.live.target import parse_target


MICRO = 1e-6 * hand.GRAVITY
TARGET = parse_target("accel.bias=40 ug, accel.scale=60 ppm")
LIMITS = np.array([40.0 * MICRO] * 3 + [60e-6, np.inf, 60e-6, np.inf, np.inf, 60e-6])
NOISE, SCATTER = (
    20.0 * MICRO,
    10.0 * MICRO,
)  # in the mean of a minute, and from one positioning to the next
MINUTE, LENGTH = 60.0, 20.0  # s; the length of a rest of `live`
BETTER = 0.1  # than the devices of a hand
CAMPAIGN = Campaign((), Site(hand.GRAVITY), Rig(), grade="tactical")
LONGEST = 400  # rests


def device_of(rng: np.random.Generator) -> hand.Device:
    """A device of a table, at one temperature."""
    made = hand.Device(rng)
    made.bias = BETTER * made.bias
    made.lower = np.eye(3) + BETTER * (made.lower - np.eye(3))
    made.truth = BETTER * made.truth
    made.noise *= NOISE / hand.NOISE * np.sqrt(MINUTE / LENGTH)
    made.scatter *= SCATTER / hand.SCATTER
    return made


def session(rng: np.random.Generator, device: hand.Device) -> tuple[int, bool, np.ndarray]:
    """Rests until `live` stops, whether all errors are within their limits, and which intervals of 95 % hold."""
    rests, found, up = [], None, np.array([0.0, 0.0, 1.0])
    for number in range(1, LONGEST + 1):
        rests.append(hand.rest_of(rng, device, up, number))
        found = estimate(rests, CAMPAIGN, TARGET, found)
        if found.reached:
            break
        told = found.next_position()
        assert told is not None
        up = np.array(told.up) / np.linalg.norm(told.up)
    assert found is not None
    error = np.abs(device.errors(found))
    std = np.concatenate([t.posterior.std for t in found.triads])
    good = found.reached and bool(np.all(error <= LIMITS))
    return len(rests), good, error <= 1.959964 * std


def allowed() -> float:
    """Variance of a rest with which the D-optimal 18 positions hold all errors within their limits with 95 %."""
    up = optimal_positions(Invariant(gravity=hand.GRAVITY), 18).directions()
    rows, columns = np.tril_indices(3)
    row = np.concatenate([-up, -hand.GRAVITY * up[:, rows] * up[:, columns]], axis=1)
    asked = np.isfinite(LIMITS)
    covariance = np.linalg.inv(row.T @ row)[np.ix_(asked, asked)]
    normal = np.random.default_rng(0).standard_normal((100_000, int(asked.sum())))
    errors = np.abs(normal @ np.linalg.cholesky(covariance).T) / LIMITS[asked]
    return float(np.quantile(errors.max(axis=1), 0.95) ** -2.0)


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=200)
    parser.add_argument("--temperatures", type=int, default=2)
    asked = parser.parse_args()
    rests, good, inside, lengths = [], [], [], []
    variance = allowed()
    for number in range(asked.devices):
        first = device_of(np.random.default_rng([3, number, 0]))
        white = LENGTH * first.noise**2  # of a second
        rest = variance - first.scatter**2
        lengths.append(white / rest if rest > 0.0 else np.inf)
        for temperature in range(asked.temperatures):
            rng = np.random.default_rng([3, number, temperature])
            device = device_of(rng)
            device.noise, device.scatter = first.noise, first.scatter
            made, true, held = session(rng, device)
            rests.append(made)
            good.append(true)
            inside.append(held)
    length = float(np.quantile(lengths, 0.95))
    plan, live = 18 * length / 3600.0, float(np.mean(rests)) * LENGTH / 3600.0
    print(f"{asked.devices} devices, {asked.temperatures} temperatures")
    print(f"  D-optimal plan: 18 rests of {length:.0f} s, {plan:.2f} h at each temperature")
    print(
        f"  live: {np.mean(rests):.1f} rests of {LENGTH:.0f} s in the mean (median {np.median(rests):.0f}), "
        f"{live:.2f} h: ratio {live / plan:.2f}"
    )
    print(
        f"  all errors within their limits: {np.mean(good):.1%}; intervals hold {np.mean(inside):.1%}"
    )


if __name__ == "__main__":
    main()
