"""How often a diagnosis says that physics is missing where nothing is: null campaigns of every kind of model.

    python benchmarks/null_campaigns.py --seed 5 [--each 4] [--part 1/2] [--budget 460] -o NULLS

Plans, devices and noise are those of the blind proof's simulator (`benchmarks/blind/`), which imports nothing of the
package; turns by hand and lever arms are added here in NumPy. Dwells and power cycles have offsets of their own, noise
is coloured, and the rig errs by half to all of what it states. Each case is written as a campaign folder, read
and diagnosed as the command does it; `nulls.json` of every case says what came out, and a run goes on where it stopped.
"""

import argparse
import collections
import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl


sys.path.insert(0, str(Path(__file__).with_name("blind")))

import draw  # noqa: E402
import plans  # noqa: E402
import world  # noqa: E402
import writer  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from table import Plan, Table  # noqa: E402
from truth import Scene  # noqa: E402


HAND_RATE = 20.0  # samples a second of a log by hand
RESTS, REST = 24, 4.0  # of it, and seconds of each
ARM = 0.03  # m, 1 sigma of an accelerometer's place


def hand(rng, *, warms: bool = False) -> Plan:
    """Rests in random attitudes with a turn by hand before each; with `warms` the room goes up by 12 °C."""
    table = Table(HAND_RATE)
    for k in range(RESTS):
        axis = rng.standard_normal(3)
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.uniform(0.7, 1.6))
        table.move(turn * table.room_to_case)
        table.rest(REST, k)
    end = table.clock
    model = {"accel_estimator": "invariant", "gyro_estimator": "gravity"}
    plan = table.plan(
        "hand", lambda t: 25.0 + (12.0 * t / end if warms else 0.0 * t), block_seconds=1.0,
        model=model | {"temperature_degree": 1 if warms else 0},
    )  # fmt: skip
    return plan


def inclined(rng) -> Plan:
    """Rests in 18 attitudes, then turns about the case axes and about axes between them, which lever arms need."""
    table = Table(4.0)
    rest_at = plans.directions(18)
    plans._tumble(table, rest_at, rng.choice(4, 18) * np.pi / 2, 12.0, rng)
    between = (np.eye(3) + np.roll(np.eye(3), 1, axis=1)) / np.sqrt(2)
    for axis in (*np.eye(3), *between):
        target, table.angles = plans.attitude(axis, 0.0)
        table.move(target)
        for rate in rng.permutation([-120.0, -60.0, 60.0, 120.0]):
            table.spin(axis, np.deg2rad(rate), 10.0)
    model = {
        "accel_estimator": "reference", "gyro_estimator": "reference", "temperature_degree": 0,
        "lever_arms": True, "g_sensitivity": False,
    }  # fmt: skip
    return table.plan(
        "inclined", lambda t: np.full_like(np.asarray(t, float), 25.0), model=model,
        block_seconds=3.0, references=("gyro", "accel"),
    )  # fmt: skip


def with_model(make: Callable[..., Plan], **keys) -> Callable[..., Plan]:
    """The plan with more keys of `[model]`."""

    def made(rng, **settings) -> Plan:
        plan = make(rng, **settings)
        plan.model.update(keys)
        return plan

    return made


KINDS: dict[str, tuple[Callable[..., Plan], dict]] = {
    "tumble, invariant": (plans.tumble, {"model": "invariant"}),
    "tumble, reference": (plans.tumble, {"model": "reference"}),
    "tumble whose turns are logged": (plans.tumble, {"model": "reference", "turns_logged": True}),
    "tumble, static gyros": (plans.tumble, {"model": "static gyro"}),
    "sweep": (plans.sweep, {"model": "invariant"}),
    "sweep with reference": (plans.sweep, {"model": "reference"}),
    "one pose": (plans.pose, {"triad": "both"}),
    "rate table": (plans.rate, {}),
    "rate table over temperature": (plans.thermal_rate, {}),
    "g-sensitivity": (with_model(plans.mixed, g_sensitivity=True), {"accel": "reference"}),
    "together": (with_model(plans.mixed, together=True, g_sensitivity=False), {}),
    "lever arms": (inclined, {}),
    "hand": (hand, {}),
    "hand, warming": (hand, {"warms": True}),
}


def by_hand(make: Callable[..., Plan], settings: dict, rng) -> draw.Case:
    """A log by hand of a consumer device; what the blind proof works out beside its cases is left out."""
    plan, name = make(rng, **settings), "consumer"
    grade = world.GRADES[name]
    heat = world.heat(plan, grade, rng, case_tau=100.0)
    level = {k: float(rng.uniform(0.3, 1.0)) for k in ("flicker", "walk", "dwell", "session")}
    case = draw.Case(
        "null", plan, name, 9.81, 50.0, False, heat, level | {"rig": 0.0}, {}, {}, {}, {}
    )
    earth, degree = world.earth(plan, case.latitude), int(plan.model["temperature_degree"])
    for triad in plan.triads:
        ideal = case.gravity * plan.up if triad == "accel" else plan.rate + earth
        low, high = float(heat.case.min()), float(heat.case.max())
        device = world.sensor(grade, triad, degree, low, high, triad == "accel", rng)
        case.scenes[triad] = Scene(
            plan, triad, name, heat, device, ideal, plan.up, case.gravity, earth
        )
        case.noise[triad] = world.Noise.of(grade, triad, HAND_RATE, case.level, rng.spawn(1)[0])
    return case


def add_arms(case: draw.Case, rng) -> None:
    """Centripetal acceleration of three accelerometers off the centre of turns; rows with ramps are not used."""
    scene = case.scenes["accel"]
    rate, arms = case.plan.rate, ARM * rng.standard_normal((3, 3))
    felt = [np.cross(rate, np.cross(rate, arms[k]))[:, k] for k in range(3)]
    both = np.eye(3) + scene.sensor.matrix_at(case.heat.case)
    case.output["accel"] = case.output["accel"] + np.einsum("nij,jn->ni", both, np.stack(felt))


def write(kind: str, seed: int, number: int, folder: Path) -> None:
    """One case as a campaign folder."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    make, settings = KINDS[kind]
    if make is hand:
        case = by_hand(make, settings, rng)
    else:
        case = draw.stage("null", make, settings, rng)
    draw.record(case, rng)
    if case.plan.model.get("lever_arms"):
        add_arms(case, rng)
    shutil.rmtree(folder, ignore_errors=True)
    writer.write(case, folder)
    if make is hand:  # a hand writes no labels
        for file in folder.glob("*.parquet"):
            pl.read_parquet(file).drop("position", "experiment").write_parquet(file)


def verdict(folder: Path) -> dict:
    """What the diagnosis of a campaign says, or the error it ended with."""
    import jax

    from inertiax.data.campaign import load_campaign
    from inertiax.diagnose.pipeline import diagnose_campaign

    start = time.perf_counter()
    try:
        with jax.enable_x64(True):
            found, _ = diagnose_campaign(load_campaign(folder))
    except ValueError as error:
        said = {"verdict": "error", "effects": [], "why": " ".join(str(error).split())}
    else:
        named = [f"{e.name} on {', '.join(e.channels)}" for e in found.effects]
        said = {"verdict": found.verdict, "effects": named, "why": ""}
    return {**said, "seconds": round(time.perf_counter() - start, 1)}


def tell(results: dict[str, dict]) -> None:
    """Shares over all cases and each kind, on standard output."""
    counts = collections.Counter(r["verdict"] for r in results.values())
    total = sum(counts.values()) - counts["error"]
    for verdict_, number in sorted(counts.items()):
        print(f"{verdict_}: {number} of {len(results)}")
    if total:
        share = counts["missing-physics"] / total
        print(f"missing physics in {100 * share:.1f} % of {total} null campaigns")
    for name, r in sorted(results.items()):
        if r["verdict"] != "consistent":
            print(f"  {name}: {r['verdict']} {'; '.join(r['effects']) or r['why'][:300]}")


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--each", type=int, default=4, help="campaigns of each kind")
    parser.add_argument("--kinds", nargs="*", choices=list(KINDS))
    parser.add_argument("--part", default="1/1", help="K/N: every N-th case from the K-th on")
    parser.add_argument("--budget", type=float, default=float("inf"), help="s, no case after it")
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    start = time.perf_counter()
    part, parts = map(int, args.part.split("/"))
    cases = [(k, n) for n in range(args.each) for k in args.kinds or KINDS]
    results = {}
    for kind, number in cases[part - 1 :: parts]:
        name = f"{kind.replace(', ', '-').replace(' ', '-')}-{number}"
        record = args.output / name / "nulls.json"
        if not record.exists():
            if time.perf_counter() - start > args.budget:
                print("stopped for the budget; run again to go on", flush=True)
                break
            write(kind, args.seed, number, record.parent)
            record.write_text(json.dumps(verdict(record.parent)) + "\n")
        results[name] = json.loads(record.read_text())
        print(f"{name}: {results[name]['verdict']}, {results[name]['seconds']} s", flush=True)
    tell(results)


if __name__ == "__main__":
    main()
