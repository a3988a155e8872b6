"""Whether the calibration that `diagnose` writes is as good as that of `calibrate` on data that neither saw.

    python benchmarks/left_out_calibrations.py CASES [CASES ...] -o OUT [--part 1/2] [--budget 3000]

Every fifth stretch of each campaign is taken out: a dwell where positions are labelled, else a twenty-fifth of the
time. With `--turns 5` each fifth is left out in its turn, so that every stretch is judged once. Both commands get the
rest. Both calibrations compensate the whole recording, and what is left in the stretches taken out is compared here in
NumPy: |a| against g or against the reference, rates against the reference, or their means at rest.
`OUT` holds one JSON a campaign, and a run goes on where it stopped. Ratios are of rms, diagnose over calibrate; z is
the sum of the squares' differences over the root of the sum of their squares: below 2, the stretches do not tell the
two apart.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibration.calibration import Calibration
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording
from inertiax.diagnose.estimates.applied_effects import compensate
from inertiax.diagnose.pipeline import diagnose_campaign


EVERY, STRETCHES = 5, 25
STILL = (
    0.02,
    0.05,
)  # rad/s, m/s²: scatter within a second, below which an unlabelled second is a rest
WORSE = 1.01


def stretches(recording: Recording) -> np.ndarray:
    """Number of the stretch of each row."""
    if recording.position is None:
        return np.arange(len(recording.time)) * STRETCHES // len(recording.time)
    place = np.asarray(recording.position)
    new = np.diff(place, prepend=place[0]) != 0
    if recording.experiment is not None:
        number = np.asarray(recording.experiment)
        new |= np.diff(number, prepend=number[0]) != 0
    return np.cumsum(new)


def taken(recording: Recording, rows: np.ndarray) -> Recording:
    """Some rows of a recording."""
    num = len(recording.time)
    cut = lambda x: np.asarray(x)[rows] if np.ndim(x) and len(x) == num else x
    arrays, rest = eqx.partition(recording, lambda x: isinstance(x, np.ndarray))
    return eqx.combine(jax.tree.map(cut, arrays), rest)


def errors(calibration: Calibration, recording: Recording, out: np.ndarray, gravity: float) -> dict:
    """Mean errors of each stretch taken out, by triad."""
    made = compensate(calibration, recording)
    number, found = stretches(recording), {"accel": [], "gyro": []}
    for k in np.unique(number[out]):
        rows = np.flatnonzero(number == k)
        for part in seconds(recording, rows):
            if calibration.accel is not None and made.accel is not None:
                known = recording.reference_accel
                mean = made.accel[part].mean(axis=0)
                if known is None:
                    found["accel"].append([np.linalg.norm(mean) - gravity])
                else:
                    found["accel"].append(mean - np.asarray(known)[part].mean(axis=0))
            if calibration.gyro is not None and made.gyro is not None:
                known = recording.reference_gyro
                target = 0.0 if known is None else np.asarray(known)[part].mean(axis=0)
                found["gyro"].append(made.gyro[part].mean(axis=0) - target)
    return {t: np.concatenate([np.atleast_1d(e) for e in v]) for t, v in found.items() if v}


def seconds(recording: Recording, rows: np.ndarray) -> list[np.ndarray]:
    """The stretch itself where it is a labelled rest or has a reference; else its seconds of rest."""
    if recording.position is not None or recording.reference_accel is not None:
        place = recording.position
        resting = place is None or place[rows[0]] >= 0
        return [rows] if resting or recording.reference_gyro is not None else []
    clock = recording.time[rows]
    pieces = np.split(rows, np.flatnonzero(np.diff(np.floor(clock - clock[0]))) + 1)
    triads = [(recording.gyro, STILL[0]), (recording.accel, STILL[1])]
    calm = lambda piece: all(
        v is None or np.asarray(v)[piece].std(axis=0).max() < limit for v, limit in triads
    )
    return [p for p in pieces if len(p) > 5 and calm(p)]


def judge(folder: Path, turns: int) -> dict:
    """Both commands on four fifths of a campaign; each fifth is left out in its turn, up to `turns` of them."""
    campaign = load_campaign(folder)
    found, said = [], {"verdict": "error", "named": [], "lost": [], "undisclosed": [], "refused": 0}
    for turn in range(turns):
        try:
            found.append(one_turn(campaign, EVERY - 1 - turn, said))
        except ValueError as error:
            said["refused"] += 1
            said["why"] = str(error)[:300]
    for triad in ("accel", "gyro"):
        pairs = [f[triad] for f in found if triad in f]
        if pairs:
            plain, written = (np.concatenate(errors) for errors in zip(*pairs, strict=True))
            said[triad] = compared(plain, written)
            said[triad]["turns"] = [compared(*pair)["ratio"] for pair in pairs]
    return said


def one_turn(
    campaign: Campaign, which: int, said: dict
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Errors of both calibrations in the stretches left out; what the diagnosis says is added to `said`."""
    out = [stretches(r) % EVERY == which for r in campaign.recordings]
    shown = tuple(taken(r, ~o) for r, o in zip(campaign.recordings, out, strict=True))
    part: Campaign = replace(campaign, recordings=shown)
    plain = calibrate_device(part).calibration
    diagnosis, written = diagnose_campaign(part)
    if said["verdict"] != "missing-physics":
        said["verdict"] = diagnosis.verdict
    disclosed = {e.name for e in diagnosis.effects}
    names = lambda c: {n for t in c.triads for n in t.names}
    before = {e.name for e in plain.effects}
    said["named"] = sorted({*said["named"], *disclosed})
    said["lost"] = sorted({*said["lost"], *(names(plain) - names(written))})
    hidden = {e.name for e in written.effects} - disclosed - before
    said["undisclosed"] = sorted({*said["undisclosed"], *hidden})
    found = {}
    for triad in ("accel", "gyro"):
        pair = [
            np.concatenate(
                [
                    errors(c, r, o, campaign.site.gravity).get(triad, np.zeros(0))
                    for r, o in zip(campaign.recordings, out, strict=True)
                ]
            )
            for c in (plain, written)
        ]
        if len(pair[0]):
            found[triad] = (pair[0], pair[1])
    return found


def compared(plain: np.ndarray, written: np.ndarray) -> dict:
    """Both rms, their ratio, and by how many standard deviations the squares differ."""
    rms = [float(np.sqrt(np.mean(e**2))) for e in (plain, written)]
    more = written**2 - plain**2
    z = float(more.sum() / max(np.sqrt(more @ more), 1e-300))
    return {"calibrate": rms[0], "diagnose": rms[1], "ratio": rms[1] / rms[0], "z": z}


def tell(results: dict[str, dict]) -> None:
    """Counts, and every campaign in which the diagnosis' calibration is worse."""
    judged = {k: r for k, r in results.items() if r["verdict"] != "error"}
    named = [r for r in judged.values() if r["verdict"] == "missing-physics"]
    print(f"{len(results)} campaigns, {len(judged)} calibrated, effects named in {len(named)}")
    print(f"parameters lost in {sum(bool(r['lost']) for r in judged.values())}")
    print(f"undisclosed effects in {sum(bool(r['undisclosed']) for r in judged.values())}")
    ratios = [r[t]["ratio"] for r in named for t in ("accel", "gyro") if t in r]
    if ratios:
        print(
            f"ratios where effects were named: median {np.median(ratios):.3f}, largest {max(ratios):.3f}"
        )
    worse = {
        k: r
        for k, r in judged.items()
        if any(r.get(t, {}).get("ratio", 0) > WORSE for t in ("accel", "gyro"))
    }
    print(f"worse than {WORSE} x: {len(worse)}")
    for name, r in worse.items():
        said = [
            f"{t} {r[t]['ratio']:.3f} x, z {r[t]['z']:.1f}" for t in ("accel", "gyro") if t in r
        ]
        print(f"  {name}: {', '.join(r['named'])}; {'; '.join(said)}")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path, nargs="+", help="folders of campaign folders")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--part", default="1/1", help="K/N: every N-th campaign from the K-th on")
    parser.add_argument(
        "--budget", type=float, default=float("inf"), help="s, no campaign after it"
    )
    parser.add_argument(
        "--turns",
        type=int,
        default=1,
        choices=range(1, EVERY + 1),
        help="fifths left out, one by one",
    )
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    given.output.mkdir(parents=True, exist_ok=True)
    start, (part, parts) = time.perf_counter(), map(int, given.part.split("/"))
    folders = sorted(f.parent for c in given.cases for f in c.glob("*/campaign.toml"))
    for folder in folders[part - 1 :: parts]:
        path = given.output / f"{folder.parent.name}-{folder.name}.json"
        if not path.exists():
            if time.perf_counter() - start > given.budget:
                print("stopped for the budget; run again to go on", file=sys.stderr)
                break
            path.write_text(json.dumps(judge(folder, given.turns)))
    tell({p.stem: json.loads(p.read_text()) for p in sorted(given.output.glob("*.json"))})


if __name__ == "__main__":
    main()
