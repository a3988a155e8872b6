"""How a filter with calibration states does against one that trusts its calibration, against 15 and 21 states.

    python benchmarks/navigation_filter.py [--runs 50] [--out scores.jsonl] [--seconds 400] [--tune]

Each run draws a flight, a device from the calibration's covariance, noise and an initial error
(`navigation_truth.py`, in
NumPy alone), and gives the same outputs and fixes to every filter. Fixes (1 Hz) are away for 60 s at a time. The
filters:

    full      all coefficients over temperature, with the calibration's full covariance as prior
    known     told the true calibration
    trusted   the calibration counts as exact
    15, 21    constant biases; constant biases and scale factors; no thermal states
    15w       15 with the walk that makes its likelihood largest, on separate runs

Printed: NEES/n of attitude, velocity and position over the run (n = 9), of the calibration states and of both at its
end; the root mean square of the horizontal position error at the ends of the outages; the time of a run. Scores are
kept in a
file, and runs that are in it are not repeated.
"""

import argparse
import json
import time
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from navigation_truth import (
    ACCEL,
    averages,
    covariance,
    DEGREE,
    distort,
    Flight,
    GYRO,
    HEIGHT,
    LATITUDE,
    noise,
    RANGE,
    Sizes,
    temperature,
)

import inertiax as ix
from inertiax.calibration.calibration import TriadCalibration
from inertiax.navigation.filter import Filter
from inertiax.navigation.level_frame import LevelFrame
from inertiax.navigation.process import ImuNoise, TriadNoise
from inertiax.navigation.strapdown import ImuData
from inertiax.navigation.updates import Position, Velocity


STEP, SAMPLES = 0.01, 100
MINUTES = 30
# s; before the first the temperature has gone from one end to the other once.
FIRST_OUTAGE, OUTAGE, PERIOD = 700, 60, 250
FACTORS = [3.0, 10.0, 30.0, 100.0, 300.0]
WALKS = {"15": 100.0}  # found by --tune among FACTORS
SCALES = ["accel.scale", "gyro.scale"]


def device(sizes):
    """The calibration as it was estimated: zero coefficients with their covariance."""
    rng = np.random.default_rng(1)
    basis = ix.Polynomial(DEGREE, *RANGE)
    triads = [
        TriadCalibration(
            ix.Curve(basis, np.zeros((DEGREE + 1, len(names)))),
            covariance(names, sizes, rng),
            tuple(names),
            "reference",
        )
        for names in (ACCEL, GYRO)
    ]
    return ix.Calibration(9.81, *triads, temperature_range=RANGE)


class Run:
    """One drawn run: raw outputs, fixes, and the truth at the segments' ends."""

    def __init__(self, seed, calibration, sizes):
        rng = np.random.default_rng([7, seed])
        count = round(60 * MINUTES / STEP)
        flight = Flight(rng)
        force, rate = averages(flight.read, count, STEP)
        warm = temperature(count, STEP)
        self.true = [
            (np.linalg.cholesky(t.covariance) @ rng.normal(size=len(t.covariance))).reshape(
                DEGREE + 1, -1
            )
            for t in (calibration.accel, calibration.gyro)
        ]
        accel = distort(force, ACCEL, self.true[0], warm)
        gyro = distort(rate, GYRO, self.true[1], warm)
        accel += noise(count, STEP, sizes.accel_white, sizes.accel_flicker, sizes.accel_walk, rng)
        gyro += noise(count, STEP, sizes.gyro_white, sizes.gyro_flicker, sizes.gyro_walk, rng)
        self.data = ImuData(accel, gyro, warm, np.asarray(STEP))
        ends = np.arange(1, count // SAMPLES + 1) * STEP * SAMPLES
        self.position, self.velocity = flight.place(ends), flight.place(ends, 1)
        self.attitude = flight.attitude(ends)
        inside = (ends >= FIRST_OUTAGE) & ((ends - FIRST_OUTAGE) % PERIOD < OUTAGE)
        inside &= ends < 60 * MINUTES - OUTAGE + 1
        # The fix at an outage's last second is missing, too: its error is the drift.
        self.valid = ~inside
        self.outage_ends = np.flatnonzero(inside & ~np.append(inside[1:], False))
        draw = lambda s: s * rng.normal(size=self.position.shape)
        self.fixes = (
            Position(self.position + draw(sizes.position), sizes.position, self.valid),
            Velocity(self.velocity + draw(sizes.velocity), sizes.velocity, self.valid),
        )
        zero = np.zeros(1)
        turn = np.array([sizes.tilt, sizes.tilt, sizes.heading])
        self.start_sigma = turn
        self.start = (
            _small_turn(turn * rng.normal(size=3)) @ flight.attitude(zero)[0],
            flight.place(zero, 1)[0] + sizes.velocity * rng.normal(size=3),
            flight.place(zero)[0] + sizes.position * rng.normal(size=3),
        )


def _small_turn(v):
    angle = np.linalg.norm(v)
    x, y, z = v / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def _turn_vectors(turns):
    """Rotation vectors of small rotations, by their antisymmetric part and arcsine."""
    sine = 0.5 * np.stack(
        [
            turns[:, 2, 1] - turns[:, 1, 2],
            turns[:, 0, 2] - turns[:, 2, 0],
            turns[:, 1, 0] - turns[:, 0, 1],
        ],
        axis=1,
    )
    size = np.linalg.norm(sine, axis=1, keepdims=True)
    return sine * np.where(size > 0, np.arcsin(np.minimum(size, 1.0)) / np.maximum(size, 1e-300), 1)


def filters(calibration, sizes):
    """The compared filters, and what tells a `known` one its device's truth."""
    triad = lambda k: TriadNoise(
        *(getattr(sizes, f"{k}_{term}") for term in ("white", "flicker", "walk"))
    )
    imu = ImuNoise(triad("accel"), triad("gyro"))
    make = lambda states, **more: Filter(
        calibration, states, noise=imu, frame=LevelFrame(LATITUDE, HEIGHT), samples=SAMPLES, **more
    )
    return {
        "full": make("*"),
        "known": make(()),
        "trusted": make(()),
        "15": make("*.bias", thermal=False),
        "21": make(["*.bias", *SCALES], thermal=False),
    }


def told(filter_, run):
    """The filter with the run's true coefficients as its calibration."""
    where = lambda f: [
        f.calibration.accel.curve.coefficients,
        f.calibration.gyro.curve.coefficients,
    ]
    calibration = eqx.tree_at(where, filter_, run.true).calibration
    model = filter_.model
    return Filter(calibration, (), noise=model.noise, frame=model.frame, samples=model.samples)


def walking(filter_, factor):
    """The filter with its random walks `factor` times as large."""
    where = lambda f: [f.model.noise.accel.walk, f.model.noise.gyro.walk]
    return eqx.tree_at(where, filter_, [factor * w for w in where(filter_)])


def track(filter_, run, sizes):
    """The run through a filter."""
    start = filter_.start(
        *run.start, attitude_sigma=run.start_sigma, velocity_sigma=sizes.velocity,
        position_sigma=sizes.position,
    )  # fmt: skip
    return jax.block_until_ready(filter_.run(start, run.data, run.fixes))


def score(result, run, with_states):
    """Errors and NEES of a track against the truth."""
    pose = jax.tree.map(np.asarray, result.estimate.navigation)
    turns = run.attitude @ np.swapaxes(pose.attitude, 1, 2)
    # To first order in the small turn the group's error is the plain difference; here it is below 0.02 rad.
    error = np.concatenate(
        [_turn_vectors(turns), run.velocity - pose.velocity, run.position - pose.position], axis=1
    )
    spread = np.asarray(result.covariance)
    nees = np.einsum("ki,ki->k", error, np.linalg.solve(spread, error[:, :, None])[..., 0]) / 9
    off = error[run.outage_ends, 6:]
    # Every tenth second: neighbours say the same again.
    found = {"nees": nees[9::10].tolist(), "horizontal": np.hypot(*off.T[:2]).tolist()}
    if with_states is not None:
        count = len(with_states)
        states = np.asarray(result.last.estimate.calibration)
        both = np.concatenate([error[-1], with_states - states])
        pick = np.r_[0:9, len(result.last.covariance) - count : len(result.last.covariance)]
        p = np.asarray(result.last.covariance)[np.ix_(pick, pick)]
        found["all"] = float(both @ np.linalg.solve(p, both) / len(both))
        found["calibration"] = float(both[9:] @ np.linalg.solve(p[9:, 9:], both[9:]) / count)
    return found


def best_walk(filter_, calibration, sizes):
    """Print the likelihood by factor of the walks, over runs that are not scored."""
    runs = [Run(10_000 + k, calibration, sizes) for k in range(2)]
    for factor in FACTORS:
        tracks = [track(walking(filter_, factor), r, sizes) for r in runs]
        total = sum(float(t.log_likelihood) for t in tracks)
        print(f"walks times {factor:g}: log likelihood {total:.0f}", flush=True)


def one_run(seed, made, calibration, sizes):
    """Scores of one seed, by filter."""
    run, found = Run(seed, calibration, sizes), {"seed": seed}
    for name, filter_ in made.items():
        used = told(filter_, run) if name == "known" else filter_
        began = time.perf_counter()
        result = track(used, run, sizes)
        took = time.perf_counter() - began
        states = None
        if name == "full":
            scale = np.asarray(used.model.states.scale)
            states = np.concatenate([c.reshape(-1) for c in run.true]) / scale
        found[name] = score(result, run, states) | {"seconds": took}
    return found


def report(rows):
    """Print a line a filter."""
    drifts = {}
    for name in [k for k in rows[0] if k != "seed"]:
        runs = [r[name] for r in rows if name in r]
        drifts[name] = np.sqrt(np.mean(np.square([r["horizontal"] for r in runs])))
        nees = np.array([np.mean(r["nees"]) for r in runs])
        error = nees.std(ddof=1) / np.sqrt(len(runs)) if len(runs) > 1 else np.nan
        line = f"{name:8} ({len(runs)} runs) NEES/9 {nees.mean():7.3f} ± {error:.3f}"
        for key, said in (("calibration", "calibration states"), ("all", "both at the end")):
            if key in runs[0]:
                values = np.array([r[key] for r in runs])
                error = values.std(ddof=1) / np.sqrt(len(runs)) if len(runs) > 1 else np.nan
                line += f"; NEES/n {said} {values.mean():.3f} ± {error:.3f}"
        by_outage = np.sqrt(np.mean(np.square([r["horizontal"] for r in runs]), axis=0))
        line += f"; drift {drifts[name]:.2f} m ({', '.join(f'{d:.1f}' for d in by_outage)})"
        print(line + f"; {np.median([r['seconds'] for r in runs]):.1f} s")
    for other in [k for k in drifts if k != "full"]:
        both = [r for r in rows if other in r]
        size = lambda k, runs=both: np.sqrt(np.mean(np.square([r[k]["horizontal"] for r in runs])))
        print(f"drift, full / {other}: {size('full') / size(other):.3f}")


def main():
    """Run the seeds that are not in the file yet, then print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--out", default="navigation_filter.jsonl", help="scores, one run a line")
    parser.add_argument("--seconds", type=float, default=np.inf, help="stop after the run in hand")
    parser.add_argument(
        "--without", default="", help="filters that are left out, such as trusted,15w"
    )
    parser.add_argument("--tune", action="store_true", help="find the walk of 15w")
    options = parser.parse_args()
    began, sizes = time.monotonic(), Sizes()
    calibration = device(sizes)
    made = filters(calibration, sizes)
    if options.tune:
        best_walk(made["15"], calibration, sizes)
        return
    made |= {f"{k}w": walking(made[k], factor) for k, factor in WALKS.items()}
    made = {k: f for k, f in made.items() if k not in options.without.split(",")}
    path = Path(options.out)
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {r["seed"] for r in rows}
    for seed in [s for s in range(options.runs) if s not in done]:
        rows.append(one_run(seed, made, calibration, sizes))
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        if time.monotonic() - began > options.seconds:
            break
    print(f"{len(rows)} runs of {MINUTES} min")
    report(rows)


if __name__ == "__main__":
    with jax.enable_x64(True):
        main()
