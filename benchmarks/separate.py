"""How often one proposed run leaves the true name alone, where a diagnosis gave a set; beside it a random run.

A device with one effect goes through a plan that shows it without telling what it is. Where `diagnose` names a set that
holds the truth, `separate` proposes a run; the same device goes through it, and both are diagnosed together. Beside it
the device goes in as many minutes through positions in random order, and where there is a chamber through a random path
of temperature. The effects are the catalogue's own formulas, so that this judges the plan and not the catalogue.

    python benchmarks/separate.py [--campaigns 10] [--first 0]
"""

import argparse
import dataclasses
import time
from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose, Diagnosis
from inertiax.diagnose.plan.run_menu import FASTEST, Run
from inertiax.diagnose.plan.separate import AFTER, NameSet, separate
from inertiax.diagnose.problem import prepare, with_outputs
from inertiax.effects import CATALOGUE, Variant
from inertiax.effects.effect import addition
from inertiax.simulate.bench import simulate_recordings
from inertiax.simulate.scenario import plan_of, PlanTable, Scenario
from inertiax.simulate.triad import Device, draw_accelerometers, Noise


RATE = 2.0  # Hz
NOISE = Noise(accel=4e-4)  # m/s²/√Hz
MOST_TRIES = 10  # campaigns for each that gives a set
EFFECTS = {e.name: e for e in CATALOGUE}


@dataclasses.dataclass(frozen=True)
class Kind:
    """A plan with a model, and effects of which it does not tell which one is there."""

    plan: PlanTable
    degree: int
    effects: tuple[tuple[str, dict], ...]
    rms: tuple[float, float]  # m/s², of the effect over the campaign: seen, and not told


def plan(temperatures: Sequence[float], change: float) -> PlanTable:
    """Eighteen positions at each temperature, that drifts by `change` in each."""
    return PlanTable(
        programme="18",
        temperatures=tuple(temperatures),
        change=change,
        drift="one-sided",
        dwell_time=50.0,
        soak_time=0.0,
    )


KINDS = (
    Kind(
        plan((25.0,), 0.0),
        0,
        (
            ("drift", {"on": "bias"}),
            ("warm_up", {"time_constant": 600.0, "start": "each"}),
            ("warm_up", {"time_constant": 1200.0, "start": "each"}),
        ),
        (5.0e-4, 1.5e-3),
    ),
    Kind(
        plan((20.0,), 8.0),
        0,
        (("temperature_dependence", {"terms": 1, "on": "bias"}), ("drift", {"on": "bias"})),
        (1.2e-4, 5.0e-4),
    ),
)


def recorded(key, said: PlanTable, device: Device, after: Sequence[Recording]) -> list[Recording]:
    """What the device sends on a plan, behind recordings that there are."""
    made, _ = simulate_recordings(
        key, plan_of(Scenario(plan=said)), device, noise=NOISE, sample_rate=RATE
    )
    start = max((float(r.time[-1]) + AFTER for r in after), default=0.0)
    return [
        Recording(
            time=r.time + start,
            accel=r.accel,
            temperature=r.temperature,
            position=r.position,
            experiment=np.full(r.num_samples, len(after) + k),
        )
        for k, r in enumerate(made)
    ]


def campaign_of(recordings: Sequence[Recording], degree: int) -> Campaign:
    """The campaign with the model that leaves the effect out."""
    model = ModelChoice(accel_estimator="invariant", temperature_degree=degree)
    gravity = plan_of(Scenario()).gravity
    return Campaign(tuple(recordings), Site(float(gravity)), Rig(), model, "tactical")


def with_effect(campaign: Campaign, name: str, variant: Variant, coefficients) -> Campaign:
    """The campaign with the effect in its outputs."""
    problem = prepare(campaign, ())
    added = np.asarray(addition(EFFECTS[name], coefficients, variant, problem.triads[0].signal))
    log = eqx.tree_at(lambda g: g.accel, problem.log, problem.log.accel + added)
    return with_outputs(campaign, log)


def random_plan(run: Run, first: PlanTable, rng: np.random.Generator) -> PlanTable:
    """Random positions for as long as the run, and where the campaign's temperature moved a random path of it."""
    count = int((run.seconds + 10.0) // 60.0)
    angles = rng.uniform(-180.0, 180.0, (count, 2)).round(1)
    change = np.max(first.change)
    pieces = max(count // 6, 1) if change else 1
    low = first.temperatures[0]
    most = min(change, FASTEST * (6 * 60.0 - 10.0) / 60.0)
    path = low + most * rng.uniform(0.0, 1.0, pieces + 1)
    positions = angles[: max(count // pieces, 1)]
    return PlanTable(
        positions=tuple((float(a), float(b)) for a, b in positions),
        temperatures=tuple(float(t) for t in path[:-1]),
        change=tuple(float(x) for x in np.diff(path)) if change else 0.0,
        drift="one-sided",
        dwell_time=50.0,
        slew_time=10.0,
        soak_time=0.0,
    )


def named(found: Diagnosis, channel: str) -> tuple[str, ...]:
    """The names that are left on a channel; none where nothing is named there."""
    for effect in found.effects:
        if channel in effect.channels:
            return (effect.name, *effect.alternatives)
    return ()


def one(seed: int, kind: Kind) -> tuple[bool, bool, str] | None:
    """Whether the proposed and the random run leave the truth alone; `None` where the campaign gave no set."""
    rng, key = np.random.default_rng(seed), jax.random.key(seed)
    name, settings = kind.effects[rng.integers(len(kind.effects))]
    channel = int(rng.integers(3))
    device = Device(
        accel=draw_accelerometers(jax.random.fold_in(key, 1), grade="tactical", degree=0)
    )
    variant = Variant("", settings)
    clean = recorded(jax.random.fold_in(key, 2), kind.plan, device, ())
    signal = prepare(campaign_of(clean, kind.degree), ()).triads[0].signal
    unit = np.zeros((3, np.asarray(EFFECTS[name].shape(signal, **settings)).shape[2]))
    unit[channel] = 1.0
    rms = float(np.sqrt(np.mean(np.asarray(addition(EFFECTS[name], unit, variant, signal)) ** 2)))
    # The mean square over three channels of which one has the effect.
    sizes = unit * rng.uniform(*kind.rms) / (rms * np.sqrt(3.0)) * rng.choice([-1.0, 1.0])
    seen = lambda further: with_effect(
        campaign_of([*clean, *further], kind.degree), name, variant, sizes
    )
    first = seen([])
    names = named(diagnose(first), f"accel_{'xyz'[channel]}")
    if len(names) < 2 or name not in names:
        print(f"{seed}: {name} was named {names}, no set", flush=True)
        return None
    chosen = separate(first, NameSet(names, (f"accel_{'xyz'[channel]}",)))
    outcomes = []
    for k, said in enumerate((chosen.best.run.plan, random_plan(chosen.best.run, kind.plan, rng))):
        further = recorded(jax.random.fold_in(key, 3 + k), said, device, clean)
        left = named(diagnose(seen(further)), f"accel_{'xyz'[channel]}")
        outcomes.append(left)
    said = (
        f"{name} in {names}: {chosen.best.run.name}, {chosen.best.run.minutes:.0f} min, least expected log Bayes "
        f"factor {chosen.best.worst:.1f}; left {outcomes[0]}, by a random run {outcomes[1]}"
    )
    return outcomes[0] == (name,), outcomes[1] == (name,), said


def main() -> None:
    """Print each campaign with its outcome, and the shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--campaigns", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found: list[tuple[bool, bool]] = []
    begin = time.monotonic()
    for seed in range(asked.first, asked.first + MOST_TRIES * asked.campaigns):
        outcome = one(seed, KINDS[seed % len(KINDS)])
        if outcome is None:
            continue
        found.append(outcome[:2])
        print(f"{seed}: {outcome[2]} ({time.monotonic() - begin:.0f} s)", flush=True)
        if len(found) == asked.campaigns:
            break
    if not found:
        print("no campaign gave a set")
        return
    proposed, random = np.sum(found, axis=0)
    print(
        f"of {len(found)} sets the truth was left alone by the proposed run {proposed} times, by a random one {random}"
    )


if __name__ == "__main__":
    main()
