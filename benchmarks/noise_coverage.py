"""How often 95 % intervals hold the truth under noise as devices have it, for every estimator.

    python benchmarks/noise_coverage.py [--logs 300] [--only hand/mems/6] [--command calibrate] [--seed 0] [-o FILE]

Logs are made by the lines below, which share no code with the package: attitudes, motions between them as mean rates,
and noise that is white, or white with flicker, random walk and a transient after each motion (mems; wander: four times
as strong; walk, settling: its random walk or its transients alone, four times as strong), or white with a hand's tremor
in the rests. Rests last 2, 6 or 20 s. The device is drawn anew in every log.

| station | accelerometers | gyros |
|---|---|---|
| hand | invariant, 24 rests | by gravity between the rests |
| few | as hand, 13 rests | by gravity |
| faces | six faces, 4 rests each | by gravity |
| table | by reference, 24 rests | by reference, a staircase of rates about each axis |

`--command diagnose` judges the calibrations that `diagnose` writes, of logs with a hidden effect, by what was named;
`fleet` those of one run over all logs. A bias is judged against the sensor's own beside its slow noise ("sensor"),
against the mean over the rests' samples of this log ("log"), and against that of its last second, by what is said of
the log's end ("last").
"""

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import polars
from scipy.signal import lfilter

from inertiax.calibrate.bias_moment import moment_words
from inertiax.calibrate.pipeline import calibrate_device, DeviceResult
from inertiax.calibrate.slow_noise import wander
from inertiax.calibration.calibration import Calibration
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.fleet import fleet_calibration, run_fleet


G, RATE = 9.81, 50.0  # m/s²; Hz
MOVE = 1.5  # s
ACCEL, GYRO = 0.02, 1e-3  # noise of a sample, m/s², rad/s
FACES = np.concatenate([np.eye(3), -np.eye(3)])
STAIRS = np.deg2rad([20.0, -20.0, 100.0, -100.0])
WITHIN = 1.959964
SLOW = {
    "mems": 0.06,
    "wander": 0.25,
    "walk": 0.25,
    "settling": 0.25,
}  # slow noise in sigmas of a sample's white noise


class Log(NamedTuple):
    """One log with its truth."""

    campaign: Campaign
    truth: dict[str, float]  # by parameter
    slow: dict[str, np.ndarray]  # mean of each triad's slow noise over the rests
    last: dict[str, np.ndarray]  # and over the last second


def flicker(rng: np.random.Generator, count: int, level: float) -> np.ndarray:
    """Three axes of 1/f noise by its spectrum, with `level`² of variance in each octave."""
    long = 2 * count
    frequency = np.fft.rfftfreq(long)
    frequency[0] = np.inf  # no mean over twice the log
    shape = rng.standard_normal((len(frequency), 3)) + 1j * rng.standard_normal((len(frequency), 3))
    power = level**2 / np.log(2.0) / frequency  # per cycle and sample
    spectrum = shape * np.sqrt(0.25 * long * power)[:, None]
    return np.fft.irfft(spectrum, long, axis=0)[:count]


def slow_noise(rng: np.random.Generator, kind: str, sigma: float, since: np.ndarray) -> np.ndarray:
    """What an output has beside white noise, in its unit; `since` the motion, s."""
    count = len(since)
    if kind == "tremor":  # of a hand: a band about 9 Hz, the same strength in all rests
        step = np.exp(-2.0 * np.pi * 2.0 / RATE)
        turn = step * np.exp(2j * np.pi * 9.0 / RATE)
        drive = rng.standard_normal((count, 3)) + 1j * rng.standard_normal((count, 3))
        return 2.0 * sigma * np.real(lfilter([np.sqrt(1 - step**2)], [1.0, -turn], drive, axis=0))
    if kind == "white":
        return np.zeros((count, 3))
    size = SLOW[kind] * sigma
    walk = np.cumsum(rng.standard_normal((count, 3)), axis=0) * 0.5 * size / np.sqrt(120.0 * RATE)
    settle = (
        size * rng.standard_normal(3) * np.exp(-since / 0.7)[:, None]
    )  # of one size after every motion
    alone = {"walk": walk, "settling": settle}
    return alone[kind] if kind in alone else flicker(rng, count, size / 4.0) + walk + settle


def carried(vector: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """A vector turned about a unit axis by each of the angles (Rodrigues' formula)."""
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return c * vector + s * np.cross(axis, vector) + (1.0 - c) * (axis @ vector) * axis


def attitudes(rng: np.random.Generator, station: str) -> np.ndarray:
    """Gravity's directions in the case, a rest each."""
    if station == "faces":
        # A case that is not square: a face is off alike each time, so that no misalignment shows.
        ups = np.tile(FACES + rng.normal(0.0, 0.12, (6, 3)), (4, 1))
    else:
        corners = [[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]
        edges = [[a, b, 0] for a in (1, -1) for b in (1, -1)] + [[a, 0, 1] for a in (1, -1)]
        ups = np.concatenate(
            [FACES, corners, edges, [[0, 1, -1], [1, 0, -1], [0, 1, 1], [0, -1, 1]]]
        )
        spread = 0.0 if station == "table" else 0.15
        ups = ups[rng.permutation(len(ups))][: 13 if station == "few" else None]
        ups = ups + rng.normal(0.0, spread, (len(ups), 3))
    return ups / np.linalg.norm(ups, axis=1, keepdims=True)


def turned(rng: np.random.Generator, ups: np.ndarray, rest: float) -> dict[str, np.ndarray]:
    """A log turned by hand between the directions: force and rate as felt, rests, time since the motion."""
    force, rate, since = [], [], []
    count, part = int(rest * RATE), int(MOVE * RATE) // 3
    # Of a part's whole angle: what each sample turns, and where its middle is.
    each = np.diff(0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, part + 1))))
    middle = np.cumsum(each) - 0.5 * each
    for number, up in enumerate(ups):
        if number:
            before = ups[number - 1]
            axis = np.cross(before, up)
            if np.linalg.norm(axis) < 1e-6:  # half a turn
                axis = np.cross(before, before[[1, 2, 0]] + 0.1)
            axis = axis / np.linalg.norm(axis)
            tilt = np.arctan2(np.linalg.norm(np.cross(before, up)), before @ up)
            # Before and after the tilt it turns about gravity, so that every axis turns.
            first, last = rng.normal(0.0, 0.7, 2)
            for start, about, angle in (
                (before, before, first),
                (before, -axis, tilt),
                (up, up, last),
            ):
                rate.append(RATE * angle * each[:, None] * about)
                force.append(G * carried(start, about, -angle * middle))
                since.append(np.full(part, -1.0))
        force.append(np.tile(G * up, (count, 1)))
        rate.append(np.zeros((count, 3)))
        since.append(np.arange(count) / RATE)
    felt = {"force": np.concatenate(force), "rate": np.concatenate(rate)}
    still = np.concatenate(since) >= 0.0
    felt["force"] = felt["force"] + rng.normal(0.0, 1.5, (len(still), 3)) * ~still[:, None]
    return felt | {"still": still, "since": np.maximum(np.concatenate(since), 0.0)}


def commanded(ups: np.ndarray, rest: float) -> dict[str, np.ndarray]:
    """A table's log: the rests, then a staircase of rates about each axis, gravity along it."""
    plan = [(u, np.zeros(3)) for u in ups]
    plan += [(u, s * u) for u in np.eye(3) for s in STAIRS]
    count = int(rest * RATE)
    up, rate = (np.repeat([p[k] for p in plan], count, axis=0) for k in (0, 1))
    number = np.repeat(np.arange(len(plan)), count)
    return {
        "force": G * up,
        "rate": rate,
        "still": np.ones(len(up), bool),
        "since": np.tile(np.arange(count) / RATE, len(plan)),
        "position": np.where(number < len(ups), number, -1),
        "experiment": np.zeros(len(up), int),
    }


def draw(station: str, kind: str, rest: float, rng: np.random.Generator) -> Log:
    """One log."""
    ups = attitudes(rng, station)
    felt = commanded(ups, rest) if station == "table" else turned(rng, ups, rest)
    lower = np.ones((3, 3)) if station == "table" else np.tril(np.ones((3, 3)))
    # Six faces hold misalignments at zero, and state what the usual 10 mrad of one would do.
    usual = 0.01 if station == "faces" else 0.004
    errors = {
        "accel": (
            rng.normal(0.0, 0.1, 3),
            lower
            * (
                rng.normal(0.0, usual, (3, 3)) * (1 - np.eye(3))
                + np.diag(rng.normal(0.0, 0.008, 3))
            ),
        ),
        "gyro": (rng.normal(0.0, 0.015, 3), rng.normal(0.0, 0.006, (3, 3))),
    }
    truth, slow, last, outputs = {}, {}, {}, {}
    for triad, sigma, key in (("accel", ACCEL, "force"), ("gyro", GYRO, "rate")):
        bias, matrix = errors[triad]
        extra = slow_noise(rng, kind, sigma, felt["since"])
        clean = felt[key] @ (np.eye(3) + matrix).T + bias
        outputs[triad] = clean + extra + rng.normal(0.0, sigma, clean.shape)
        # A tremor is noise about the bias, as white noise is
        slow[triad] = extra[felt["still"]].mean(axis=0) * (kind != "tremor")
        last[triad] = extra[-int(RATE) :].mean(axis=0) * (kind != "tremor")
        for i in range(3):
            truth[f"{triad}.bias[{i}]"] = float(bias[i])
            for j in range(3):
                truth[f"{triad}.matrix[{i},{j}]"] = float(matrix[i, j])
    columns = {}
    if station == "table":
        columns = {
            "reference_accel": felt["force"],
            "reference_gyro": felt["rate"],
            "position": felt["position"],
            "experiment": felt["experiment"],
        }
    time = np.arange(len(felt["rate"])) / RATE
    recording = Recording(time=time, name="log", **outputs, **columns)  # pyright: ignore[reportArgumentType]
    model = ModelChoice(temperature_degree=None)
    return Log(Campaign((recording,), Site(gravity=G), model=model), truth, slow, last)


def deviations(
    log: Log, calibration: Calibration, alike: dict[str, float] | None = None
) -> dict[str, float]:
    """Errors in stated sigmas, by parameter; biases against all meanings, the last second's with the stated wander."""
    made = {}
    for triad in calibration.triads:
        sigma = np.sqrt(np.diagonal(np.asarray(triad.covariance)))
        for value, one, name in zip(
            np.asarray(triad.curve.coefficients).ravel(), sigma, triad.names, strict=True
        ):
            error = float(value) - log.truth[name]
            made[name] = error / float(one)
            kind, _, index = name.partition(".bias[")
            if index:
                axis = int(index[0])
                made[f"{name} log"] = (error - log.slow[kind][axis]) / float(one)
                if alike is not None and kind in alike:
                    now = float(error - log.last[kind][axis])
                    made[f"{name} last"] = now / float(np.hypot(one, alike[kind]))
    return made


def stated_wander(result: DeviceResult) -> dict[str, float]:
    """How far a bias is said to be off at the log's end, by triad; none where nothing is said."""
    found = {}
    for kind, triad in (("accel", result.accel), ("gyro", result.gyro)):
        if triad is not None:
            rows = triad.dwells if triad.fitted is None else triad.fitted
            if moment_words(triad):
                found[kind] = wander(rows, triad.estimator, triad.slow_noise)
    return found


def bent(log: Log) -> Log:
    """The log with a hidden term in the square of accelerometer x's force, 12 sigma of a rest's mean at 1 g."""
    (recording,) = log.campaign.recordings
    accel = np.array(recording.accel)
    accel[:, 0] += 12.0 * ACCEL / np.sqrt(6.0 * RATE) * (accel[:, 0] / G) ** 2
    return log._replace(
        campaign=replace(log.campaign, recordings=(replace(recording, accel=accel),))
    )


def in_a_fleet(logs: list[Log]) -> list[Calibration]:
    """The calibrations of one fleet run over all logs."""
    with tempfile.TemporaryDirectory() as folder:
        for number, log in enumerate(logs):
            (recording,) = log.campaign.recordings
            columns: dict[str, np.ndarray] = {"time": recording.time}
            for name in ("accel", "gyro", "reference_accel", "reference_gyro"):
                values = getattr(recording, name)
                if values is not None:
                    columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
            for name in ("position", "experiment"):
                values = getattr(recording, name)
                if values is not None:
                    columns[name] = values
            frame = polars.DataFrame(columns).with_columns(device=polars.lit(f"log{number}"))
            frame.write_parquet(Path(folder) / f"log{number}.parquet")
        toml = Path(folder) / "campaign.toml"
        toml.write_text(f'[site]\ngravity = {G}\n[recordings]\nfiles = ["*.parquet"]\n')
        run_fleet(Path(folder), Path(folder) / "found", workers=1)
        return [
            fleet_calibration(Path(folder) / "found", f"log{number}") for number in range(len(logs))
        ]


def kind_of(name: str) -> str:
    """Row of the table."""
    triad, _, rest = name.partition(".")
    if rest.startswith("bias"):
        _, _, moment = rest.partition(" ")
        return f"{triad} bias, {moment or 'sensor'}"
    return f"{triad} {'scale' if rest[7] == rest[9] else 'misalignment'}"


def tell(case: str, found: list[dict]) -> str:
    """One line of shares within 95 % intervals ± their standard errors, by logs, and root mean squares."""
    kinds = sorted({kind_of(name) for one in found for name in one})
    said = []
    for kind in kinds:
        logs = [[z for name, z in one.items() if kind_of(name) == kind] for one in found]
        held = [100.0 * np.mean(np.abs(z) < WITHIN) for z in logs if z]
        within, all_z = np.mean(held), np.concatenate(logs)
        error = np.std(held) / np.sqrt(max(len(held) - 1, 1))
        said.append(f"{kind} {within:.1f} ± {error:.1f} ({np.sqrt(np.mean(all_z**2)):.2f})")
    return f"{case}, {len(found)} logs: {'; '.join(said)}"


def as_named(names: Sequence[str]) -> str:
    """Under what a hidden second-order term is counted."""
    if not names:
        return " nothing named"
    return " named so" if "second_order" in names else " under another name"


def judged(
    case: str, logs: int, seed: int, command: str
) -> tuple[dict[str, list[dict]], dict[str, int]]:
    """Deviations of each log of a case by a command, of `diagnose` by what it named, and how many were refused for
    which reason."""
    station, kind, rest = case.split("/")
    rngs = [np.random.default_rng([seed, number, sum(map(ord, case))]) for number in range(logs)]
    drawn = (draw(station, kind, float(rest), rng) for rng in rngs)
    if command == "fleet":
        every = list(drawn)
        pairs = zip(every, in_a_fleet(every), strict=True)
        return {"": [deviations(*pair) for pair in pairs]}, {}
    found, failed = defaultdict(list), defaultdict(int)
    for log in drawn:
        try:
            if command == "diagnose":
                told, calibration = diagnose_campaign(bent(log).campaign)
                stated, label = None, as_named([effect.name for effect in told.effects])
            else:
                result = calibrate_device(log.campaign, checked=True)
                calibration, stated, label = result.calibration, stated_wander(result), ""
            found[label].append(deviations(log, calibration, stated))
        except ValueError as error:
            failed[str(error)[:90]] += 1
    return dict(found), dict(failed)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--logs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", action="append", default=[], help="STATION/NOISE/SECONDS")
    parser.add_argument(
        "--command", choices=("calibrate", "diagnose", "fleet"), default="calibrate"
    )
    parser.add_argument("-o", "--output", type=Path)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cases = given.only or [
        f"{s}/{n}/{d}"
        for s, noises in (
            ("hand", ("white", "mems", "wander", "tremor")),
            ("faces", ("white", "mems", "wander", "tremor")),
            ("table", ("white", "mems", "wander")),
        )
        for n in noises
        for d in (2, 6, 20)
    ]
    for case in cases:
        found, failed = judged(case, given.logs, given.seed, given.command)
        for label, ones in sorted(found.items()):
            print(tell(case + label, ones), flush=True)
        every = [one for ones in found.values() for one in ones]
        if len(found) != 1 or failed:
            print(tell(case, every) if every else case, failed or "", flush=True)
        if given.output is not None:
            with given.output.open("a") as file:
                file.write(json.dumps({"case": case, "by": given.command, "logs": every}) + "\n")


if __name__ == "__main__":
    main()
