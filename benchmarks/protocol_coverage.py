"""How often a protocol's expanded intervals cover the truth, and how often its decisions at the limit are wrong.

    python benchmarks/protocol_coverage.py [--runs 300] [--seed 0] [--station "g alone" | table]

Two stations are simulated by the few lines below, which share no code with the package: one that only knows g, and a
table in a chamber with references for both triads. Every run draws everything anew: the device, noise, what each
re-positioning does, the positions' angles, the error common to all rates, the offset of the probe and the error of g.
Each result (parameter, temperature) counts as covered where |value - truth| is within the expanded uncertainty. For the
decisions every parameter gets a limit at the largest true absolute value over the range: there a pass is wrong with a
limit just below, and a fail with one just above.
"""

import argparse
import math
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.protocol.make_record import record_of
from inertiax.protocol.measurement import Measurement
from inertiax.protocol.protocol import make_protocol, Protocol
from inertiax.protocol.requirements import Limit
from inertiax.protocol.station import Station, StationTable


G, G_SIGMA = 9.81, 3e-4  # m/s²
PROBE = 0.3  # °C
ANGLE, RATE = 5e-5, 1e-4  # rad of each positioning, relative
TEMPERATURES = np.array([0.0, 20.0, 40.0])  # °C
SAMPLES, STEP = 25, 0.1  # of a dwell; s
ACCEL_NOISE, GYRO_NOISE = 2e-3, 2e-4  # of a sample, m/s², rad/s
MOVED = {"g alone": 1e-3, "table": 3e-4}  # of every re-positioning, each axis, m/s²
SPEED = 1.0  # rad/s of the plateaus

FACES = np.concatenate([np.eye(3), -np.eye(3)])
CORNERS = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / math.sqrt(3.0)
UP = np.concatenate([FACES, CORNERS])


class Truth:
    """Errors of one triad, linear in temperature: bias, and a matrix that is lower triangular where only g is known."""

    def __init__(self, rng: np.random.Generator, bias: float, *, lower: bool):
        keep = np.tril(np.ones((3, 3))) if lower else np.ones((3, 3))
        self.bias = rng.normal(0.0, bias, 3), rng.normal(0.0, bias / 200.0, 3)
        self.matrix = keep * rng.normal(0.0, 3e-3, (3, 3)), keep * rng.normal(0.0, 2e-5, (3, 3))

    def at(self, heat: float) -> tuple[np.ndarray, np.ndarray]:
        """Bias and matrix at a temperature, °C."""
        return tuple(start + slope * (heat - 20.0) for start, slope in (self.bias, self.matrix))

    def output(self, heat: float, felt: np.ndarray) -> np.ndarray:
        """What the triad reads."""
        bias, matrix = self.at(heat)
        return felt + matrix @ felt + bias

    def value(self, name: str, heat: float) -> float:
        """A parameter by its name in the results."""
        bias, matrix = self.at(heat)
        index = [int(i) for i in name.partition("[")[2].rstrip("]").split(",")]
        return float(bias[index[0]] if ".bias" in name else matrix[index[0], index[1]])


def turned(vector: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """The vector after a small rotation (first order: angles are 5e-5)."""
    return vector + np.cross(angles, vector)


def draw(
    station: str, rng: np.random.Generator, *, common: bool = True
) -> tuple[Campaign, dict[str, Truth]]:
    """One campaign, with the truth.

    With `common` g has an error, and the error of the rates is one for all of them; else g has none, and every plateau
    has its own.
    """
    table = station == "table"
    truth = {"accel": Truth(rng, 0.1, lower=not table)}
    if table:
        truth["gyro"] = Truth(rng, 1e-3, lower=False)
    really = G + (rng.normal(0.0, G_SIGMA) if common else 0.0)
    offset, scale = rng.normal(0.0, PROBE), 1.0 + rng.normal(0.0, RATE)
    columns = defaultdict(list)
    number, angles = 0, np.zeros(3)
    for heat in TEMPERATURES:
        plan = [(u, np.zeros(3)) for u in UP]
        if table:  # about each axis, both ways, with gravity along it
            plan += [(u, SPEED * s * u) for u in np.eye(3) for s in (1.0, -1.0)]
        for up, rate in plan:
            moving = bool(np.any(rate))
            back = moving and rate @ up < 0.0  # the table turns the other way, in the same position
            if table and not back:
                angles = rng.normal(0.0, ANGLE, 3)
            force = turned(really * up, angles)
            level = truth["accel"].output(heat, force) + rng.normal(0.0, MOVED[station], 3)
            columns["accel"].append(level + rng.normal(0.0, ACCEL_NOISE, (SAMPLES, 3)))
            columns["temperature"].append(np.full((SAMPLES, 1), heat + offset))
            columns["position"].append(np.full(SAMPLES, -1 if moving else number))
            columns["experiment"].append(np.full(SAMPLES, number))
            columns["time"].append(STEP * np.arange(SAMPLES) + 10.0 * number)
            if table:
                own = scale if common else 1.0 + rng.normal(0.0, RATE)
                felt = turned(own * rate, angles)
                columns["gyro"].append(
                    truth["gyro"].output(heat, felt) + rng.normal(0.0, GYRO_NOISE, (SAMPLES, 3))
                )
                columns["reference_accel"].append(np.tile(G * up, (SAMPLES, 1)))
                columns["reference_gyro"].append(np.tile(rate, (SAMPLES, 1)))
            number += 1
    recording = Recording(**{k: np.concatenate(v) for k, v in columns.items()})
    rig = Rig(ANGLE if table else None, RATE if table else None, PROBE)
    model = ModelChoice(temperature_degree=1)
    return Campaign((recording,), Site(gravity=G), rig=rig, model=model), truth


def protocols_of(campaign: Campaign, several: list[tuple[Limit, ...]]) -> list[Protocol]:
    """What `inertiax protocol` would say of it, with one list of limits after another."""
    found = calibrate_device(campaign)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "calibration.json").write_text("{}")  # whose hash stands in the record
        record = record_of(found, campaign, Path(folder), "benchmark", ())
    station = Station(station=StationTable(gravity_uncertainty=G_SIGMA))
    return [
        make_protocol(Measurement(found.calibration, record), station, limits) for limits in several
    ]


def limits_of(truth: dict[str, Truth], part: float) -> tuple[Limit, ...]:
    """For every parameter `part` of its largest true absolute value over the range; linear, so at one of its ends."""
    made = []
    for triad, true in truth.items():
        names = [f"{triad}.bias[{i}]" for i in range(3)]
        names += [f"{triad}.matrix[{i},{j}]" for i in range(3) for j in range(3)]
        for name in names:
            largest = max(abs(true.value(name, t)) for t in (TEMPERATURES[0], TEMPERATURES[-1]))
            if largest > 0.0:
                made.append(Limit(name, part * largest, ""))
    return tuple(made)


def kind(name: str) -> str:
    """The row of the table."""
    triad, _, rest = name.partition(".")
    if rest.startswith("bias"):
        return f"{triad} bias"
    return f"{triad} scale" if rest[7] == rest[9] else f"{triad} misalignment"


class Counted(NamedTuple):
    """What was counted of one station, as parts."""

    covered: dict[str, float]  # by kind of parameter
    together: float
    sigma: float  # of `together`, from run to run
    wrong: dict[str, float]  # "pass" and "fail", at the limit
    decisions: int  # of each


def count(station: str, runs: int, seed: int) -> Counted:
    """Simulate one station."""
    covered: dict[str, list[bool]] = defaultdict(list)
    each: list[float] = []
    wrong: Counter[str] = Counter()
    decided: Counter[str] = Counter()
    for run in range(runs):
        campaign, truth = draw(station, np.random.default_rng([seed, run, len(station)]))
        below, above = protocols_of(
            campaign, [limits_of(truth, 1.0 - 1e-9), limits_of(truth, 1.0 + 1e-9)]
        )
        mine = []
        for r in below.results:
            true = truth[r.name.partition(".")[0]].value(r.name, r.at)
            mine.append(abs(r.value - true) <= r.expanded)
            covered[kind(r.name)].append(mine[-1])
        each.append(float(np.mean(mine)))
        for said, mistake in ((below, "pass"), (above, "fail")):
            for r in said.requirements:
                decided[mistake] += 1
                wrong[mistake] += r.decision == mistake
    return Counted(
        {name: float(np.mean(inside)) for name, inside in covered.items()},
        float(np.mean(each)),
        float(np.std(each, ddof=1)) / math.sqrt(runs),
        {mistake: wrong[mistake] / decided[mistake] for mistake in ("pass", "fail")},
        decided["pass"],
    )


def show(station: str, runs: int, counted: Counted) -> None:
    """Print the table."""
    print(f"\n{station}: {runs} runs\n\n| parameters | covered, % |\n|---|---|")
    for name, part in counted.covered.items():
        print(f"| {name} | {100 * part:.1f} |")
    sigma = f"{100 * counted.sigma:.1f} (1 sigma, from run to run)"
    print(f"| all | {100 * counted.together:.1f} ± {sigma} |\n")
    for mistake, part in counted.wrong.items():
        print(f"wrong {mistake} at the limit: {100 * part:.2f} % of {counted.decisions}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--station", choices=list(MOVED))
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for station in [given.station] if given.station else MOVED:
        show(station, given.runs, count(station, given.runs, given.seed))


if __name__ == "__main__":
    main()
