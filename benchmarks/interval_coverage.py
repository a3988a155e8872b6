"""How often the 95 % intervals of a calibration cover the truth: those of `calibrate`, and those `diagnose` writes.

    python benchmarks/interval_coverage.py [--runs 300] [--seed 0] [--part 1/2] [--calibrate-only] -o COVERAGE

Stations and devices are those of `protocol_coverage.py`, which shares no code with the package: dwell noise, what each
re-positioning does, the angles and the rate error of every positioning and the offset of the probe are drawn anew in
every run, at their stated sizes. Errors of g and one common to all rates are what `protocol` adds, and are none here.
In every second run (none with `--calibrate-only`) one effect is hidden: a term in the square of an accelerometer's
force. Where the diagnosis names what was hidden, its calibration is judged as that of the augmented model, else as it
is.
A run is kept in `COVERAGE` as it ends, so that a run goes on where it stopped.
"""

import argparse
import json
import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import protocol_coverage as stations

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibration.calibration import Calibration
from inertiax.data.recording import Campaign
from inertiax.diagnose.pipeline import diagnose_campaign


WITHIN = 1.959964  # sigmas of a 95 % interval
HIDDEN = 12.0  # standard deviations of a position's level, of the second order term at 1 g


def hide(campaign: Campaign, station: str, rng: np.random.Generator) -> tuple[Campaign, str]:
    """The campaign with a term in the square of the true force along one axis, and its channel."""
    (recording,) = campaign.recordings
    axis, size = int(rng.integers(3)), HIDDEN * stations.MOVED[station] * rng.choice([-1.0, 1.0])
    if recording.reference_accel is None:  # positions are numbered through the temperatures
        up = stations.UP[np.asarray(recording.position) % len(stations.UP)]
    else:
        up = np.asarray(recording.reference_accel) / stations.G
    accel = np.array(recording.accel)
    accel[:, axis] += size * up[:, axis] ** 2
    return replace(campaign, recordings=(replace(recording, accel=accel),)), f"accel_{'xyz'[axis]}"


def covered(calibration: Calibration, truth: dict[str, stations.Truth]) -> dict[str, list[bool]]:
    """Whether each parameter's interval holds the truth at every temperature, by kind of parameter."""
    found: dict[str, list[bool]] = defaultdict(list)
    for triad in calibration.triads:
        values, sigmas = triad.over(stations.TEMPERATURES)
        for k, name in enumerate(triad.names):
            true = truth[name.partition(".")[0]]
            for row, heat in enumerate(stations.TEMPERATURES):
                error = abs(float(values[row, k]) - true.value(name, float(heat)))
                found[stations.kind(name)].append(error <= WITHIN * float(sigmas[row, k]))
    return found


def run_one(station: str, seed: int, number: int, *, calibrate_only: bool) -> dict:
    """One campaign through both commands, or `calibrate` alone."""
    rng = np.random.default_rng([seed, number, len(station)])
    campaign, truth = stations.draw(station, rng, common=False)
    hidden = None
    if calibrate_only:
        found = covered(calibrate_device(campaign).calibration, truth)
        return {"station": station, "hidden": None, "verdict": "not asked", "calibrate": found}
    if number % 2:
        campaign, hidden = hide(campaign, station, rng)
    plain = calibrate_device(campaign).calibration
    diagnosis, written = diagnose_campaign(campaign)
    named = [f"{e.name} on {','.join(e.channels)}" for e in diagnosis.effects]
    return {
        "station": station,
        "hidden": hidden,
        "verdict": diagnosis.verdict,
        "named": named,
        "calibrate": covered(plain, truth),
        "diagnose": covered(written, truth),
    }


def tell(results: list[dict]) -> None:
    """The shares of all runs, by station, command and kind of parameter."""
    for hidden in (False, True):
        mine = [r for r in results if (r["hidden"] is not None) == hidden]
        verdicts = defaultdict(int)
        for r in mine:
            verdicts[r["verdict"]] += 1
        print(
            f"\n{'second order hidden' if hidden else 'nothing hidden'}: {len(mine)} runs, {dict(verdicts)}"
        )
        for station in stations.MOVED:
            for command in ("calibrate", "diagnose"):
                rows = [r[command] for r in mine if r["station"] == station and command in r]
                if not rows:
                    continue
                kinds = list(dict.fromkeys(k for r in rows for k in r))
                said = [
                    f"{k} {100 * np.mean(np.concatenate([r[k] for r in rows if k in r])):.1f}"
                    for k in kinds
                ]
                each = [np.mean(np.concatenate(list(r.values()))) for r in rows]
                spread = np.std(each, ddof=1) / math.sqrt(len(each)) if len(each) > 1 else math.nan
                print(
                    f"{station}, {command}: {100 * np.mean(each):.1f} ± {100 * spread:.1f} %; {', '.join(said)}"
                )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=300, help="of each station")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--part", default="1/1", help="K/N: every N-th run from the K-th on")
    parser.add_argument("--calibrate-only", action="store_true")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    part, parts = map(int, given.part.split("/"))
    given.output.mkdir(parents=True, exist_ok=True)
    todo = [(s, n) for n in range(given.runs) for s in stations.MOVED][part - 1 :: parts]
    for station, number in todo:
        path = given.output / f"{station.replace(' ', '-')}-{number:04d}.json"
        if not path.exists():
            path.write_text(
                json.dumps(
                    run_one(station, given.seed, number, calibrate_only=given.calibrate_only)
                )
            )
    tell([json.loads(p.read_text()) for p in sorted(given.output.glob("*.json"))])


if __name__ == "__main__":
    main()
