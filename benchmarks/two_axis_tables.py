"""What both commands make of a table with two axes whose errors stay while an axis stands.

    python benchmarks/two_axis_tables.py [--seed 3] [--campaigns 12] [--arcsec 8] [--hide second_order] -o CAMPAIGNS

Plain campaigns, or such with a second order of 250 ppm/g on an accelerometer: 24 positions of a table that turns its
inner axis while the outer one stands, then staircases of rates about both. Each time that an axis is moved it gets an
error of three angles anew and keeps it as long as it stands; a staircase has one, each stop in it another. Attitudes
are SciPy's rotations, to all orders; rates are their differences from sample to sample, the device is NumPy, and only
the commands are the package's. Told are verdicts, and how many of the parameters of `calibrate` lie within their 95 %
intervals.
"""

import argparse
import collections
import json
from pathlib import Path

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation


RATE, REST = 50.0, 10.0  # Hz, s
GRAVITY, LATITUDE = 9.81, np.deg2rad(48.0)
EARTH = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])  # east, north, up
ARCSEC = np.deg2rad(1.0 / 3600.0)
OUTER, INNER = (0, 90, 180, 270, 45, 135), (0, 90, 180, 270)
STAIRS = (20.0, -20.0, 60.0, -60.0, 100.0, -100.0)  # deg/s
# Angles at which an axis runs through the staircase: about case z up and level, about x and y by the outer axis
PLATEAUS = (((0, 0), 1), ((90, 0), 1), ((0, 0), 0), ((0, 90), 0))
SECOND_ORDER = 250e-6 / GRAVITY  # per m/s²


def profile(
    outer_angles: tuple[int, ...] = OUTER, stairs: tuple[float, ...] = STAIRS
) -> tuple[np.ndarray, np.ndarray]:
    """Angles of both axes in deg, and for each a number that counts its movements."""
    angles, moves = [np.zeros((int(REST * RATE), 2))], [np.zeros((int(REST * RATE), 2), int)]

    def add(rows: np.ndarray, number: np.ndarray) -> None:
        angles.append(rows)
        moves.append(np.tile(number, (len(rows), 1)))

    def go(at: tuple[int, int]) -> None:
        start, number = angles[-1][-1], moves[-1][-1].copy()
        goal = at + 360.0 * np.round((start - at) / 360.0)  # the shorter way
        seconds = max(float(np.abs(goal - start).max()) / 30.0, 1.0)
        u = np.arange(1, int(seconds * RATE) + 1)[:, None] / int(seconds * RATE)
        number += np.abs(goal - start) > 1e-6
        add(start + (goal - start) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2), number)
        add(np.tile(goal, (int(REST * RATE), 1)), number)

    for k, outer in enumerate(outer_angles):
        for inner in INNER[:: -1 if k % 2 else 1]:
            go((outer, inner))
    for at, axis in PLATEAUS:
        go(at)
        one = np.eye(2, dtype=int)[axis]
        number = moves[-1][-1] + one
        for k, speed in enumerate(stairs):
            ramp, turn = np.linspace(0.0, 1.0, int(RATE)), int(360.0 / abs(speed) * RATE)
            shape = np.concatenate([ramp, np.ones(turn), ramp[::-1]])
            rows = np.tile(angles[-1][-1], (len(shape), 1))
            rows[:, axis] += np.cumsum(speed * shape) / RATE
            add(rows, number)
            add(np.tile(rows[-1], (int(REST / 2 * RATE), 1)), number + (k + 1) * one)
    return np.concatenate(angles), np.concatenate(moves)


def attitude(angles: np.ndarray, moves: np.ndarray, sigma: float, rng) -> Rotation:
    """From the case to the room, with the errors of each axis' standings; they change smoothly while an axis moves."""
    parts = []
    for axis in (0, 1):
        own = sigma * rng.standard_normal((moves[:, axis].max() + 1, 3))
        error = own[moves[:, axis]]
        width = int(RATE)
        padded = np.concatenate([np.repeat(error[:1], width - 1, axis=0), error])
        total = np.cumsum(np.concatenate([np.zeros((1, 3)), padded]), axis=0)
        parts.append(Rotation.from_rotvec((total[width:] - total[:-width]) / width))
    turned = np.deg2rad(angles)
    inner = Rotation.from_euler("z", turned[:, 1:]) * parts[1]
    return parts[0] * Rotation.from_euler("x", turned[:, :1]) * inner


def write(folder: Path, seed: int, arcsec: float, hide: str, **plan: tuple) -> None:
    """One campaign, and its truth beside it; `plan` are arguments of `profile`."""
    rng = np.random.default_rng(seed)
    angles, moves = profile(**plan)
    case = attitude(angles, moves, arcsec * ARCSEC, rng)
    force = case.apply([0.0, 0.0, GRAVITY], inverse=True)
    turns = (case[:-2].inv() * case[2:]).as_rotvec() * RATE / 2.0
    rate = np.concatenate([turns[:1], turns, turns[-1:]]) + case.apply(EARTH, inverse=True)
    truth, columns = {}, {"time": np.arange(len(angles)) / RATE}
    noises = {"accel": (force, 0.01, 1e-3, 3e-5), "gyro": (rate, 1e-3, np.deg2rad(0.02), 5e-7)}
    for triad, (ideal, bias, noise, wander) in noises.items():
        matrix = 2e-3 * rng.standard_normal((3, 3))
        offset = bias * rng.standard_normal(3)
        anew = np.cumsum(np.any(np.diff(moves, axis=0, prepend=moves[:1]), axis=1))
        own = wander * rng.standard_normal((anew[-1] + 1, 3))[anew]
        felt = ideal.copy()
        if hide == "second_order" and triad == "accel":
            felt[:, 1] += SECOND_ORDER * ideal[:, 1] ** 2
        made = felt @ (np.eye(3) + matrix).T + offset + own
        made += noise * rng.standard_normal(made.shape)
        columns |= {f"{triad}_{c}": made[:, k] for k, c in enumerate("xyz")}
        truth[triad] = {"bias": offset.tolist(), "matrix": matrix.tolist()}
    columns |= {"outer": angles[:, 0], "inner": angles[:, 1]}
    folder.mkdir(parents=True)
    pl.DataFrame(columns).write_parquet(folder / "log.parquet")
    (folder.parent / f"{folder.name}.truth.json").write_text(json.dumps(truth))
    (folder / "campaign.toml").write_text(f"""[site]
gravity = {GRAVITY}
latitude = {np.rad2deg(LATITUDE)}
[recordings]
files = ["log.parquet"]
[columns]
table_angles = {{ names = ["outer", "inner"], unit = "deg" }}
[table]
axes = ["east", "up"]
case = ["east", "north", "up"]
azimuth = 0.0
[rig]
position_uncertainty = {max(np.sqrt(2.0) * arcsec, 0.1)}
[device]
grade = "tactical"
""")


def judged(folder: Path) -> dict:
    """Deviations of `calibrate` from the truth in its sigmas, and the verdict of `diagnose`."""
    import jax

    from inertiax.calibrate.pipeline import calibrate
    from inertiax.data.campaign import load_campaign
    from inertiax.diagnose.pipeline import diagnose_campaign

    truth = json.loads((folder.parent / f"{folder.name}.truth.json").read_text())
    made: dict = {}
    with jax.enable_x64(True):
        campaign = load_campaign(folder)
        (result,) = calibrate(campaign)
        for triad in ("accel", "gyro"):
            fit = getattr(result, triad)
            values = np.asarray(fit.solution.curve.coefficients)[0]
            expected = np.r_[truth[triad]["bias"], np.ravel(truth[triad]["matrix"])]
            sigma = np.sqrt(np.diagonal(np.asarray(fit.solution.covariance)))
            made[triad] = ((values - expected) / sigma[: len(values)])[: len(expected)].tolist()
        found, _ = diagnose_campaign(campaign)
    named = [f"{e.name} on {', '.join(e.channels)}" for e in found.effects]
    return made | {"verdict": found.verdict, "effects": named}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--campaigns", type=int, default=12)
    parser.add_argument("--arcsec", type=float, default=8.0, help="1 sigma of each axis' angles")
    parser.add_argument("--hide", choices=("", "second_order"), default="")
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    results = []
    for k in range(args.campaigns):
        folder = args.output / f"{args.hide or 'plain'}-{args.seed}-{k}"
        if not folder.exists():
            write(folder, 1000 * args.seed + k, args.arcsec, args.hide)
        results.append(judged(folder))
        print(
            f"{folder.name}: {results[-1]['verdict']} {'; '.join(results[-1]['effects'])}",
            flush=True,
        )
    counts = collections.Counter(r["verdict"] for r in results)
    print("; ".join(f"{v}: {n} of {len(results)}" for v, n in sorted(counts.items())))
    for triad in ("accel", "gyro"):
        z = np.array([r[triad] for r in results])
        for words, which in (("biases", slice(0, 3)), ("matrix", slice(3, 12))):
            inside = 100.0 * np.mean(np.abs(z[:, which]) < 1.96)
            rms = np.sqrt(np.mean(np.square(z[:, which])))
            print(f"{triad} {words}: {inside:.0f} % within 95 % intervals, rms {rms:.2f} sigma")


if __name__ == "__main__":
    main()
