"""How the diagnosis did on real logs: as they are, and with hidden effects.

    python score.py --as-they-are RUNS [--fetched DIR]
    python score.py CASES --answers sealed/answers.json --runs RUNS --baseline RUNS_AS_THEY_ARE

A hidden effect is named where an answer's set (name and alternatives) on its triad holds it. A further name is false
where neither the unchanged log has it on that triad nor the hidden effect is in its set. As they are, a name is
confirmed where an ordinary regression (`regression.py`) sees one of its set at |z| ≥ 4 on one of its channels.
"""

import argparse
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import logs
import numpy as np
import regression
import rests


CONFIRMED = 4.0  # |z|; the steps' best moment is searched, which alone reaches 3


def wilson(hits: int, trials: int) -> str:
    """A share with its 95 % interval."""
    if trials == 0:
        return "none"
    p, z = hits / trials, 1.959964
    centre = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z * np.sqrt(p * (1 - p) / trials + z * z / (4 * trials**2)) / (1 + z * z / trials)
    return f"{hits}/{trials} = {100 * p:.1f} % ({100 * (centre - half):.0f} to {100 * (centre + half):.0f})"


def answer_of(folder: Path) -> dict[str, Any] | None:
    """`diagnosis.json` of a run; `None` where there is none."""
    path = folder / "diagnosis.json"
    return json.loads(path.read_text()) if path.exists() else None


def names_of(effect: dict[str, Any]) -> set[str]:
    """The answer's set."""
    return {effect["name"], *effect.get("alternatives", [])}


def triads_of(effect: dict[str, Any]) -> set[str]:
    """Which triads an answer is about."""
    return {channel.split("_")[0] for channel in effect["channels"]}


def named_in(found: dict[str, Any] | None, case: dict[str, Any]) -> bool:
    """Whether an answer's set on the triad holds the hidden effect."""
    triad = case["channel"].split("_")[0]
    effects_ = [] if found is None else found["effects"]
    return any(case["effect"] in names_of(e) and triad in triads_of(e) for e in effects_)


def as_they_are(runs: Path, known: list[logs.Log]) -> None:
    """A table of the unchanged logs."""
    good = 0
    for log in known:
        found = answer_of(runs / f"case-{log.name}")
        if found is None:
            print(f"{log.name:26s} no answer")
            continue
        z: dict[tuple[str, str], float] = {}
        seen = rests.find(log)
        for triad in ("accel", "gyro"):
            for name, axis, value, _ in regression.all_effects(log, seen, triad):
                key = name, f"{triad}_{'xyz'[axis]}"
                z[key] = max(abs(value), z.get(key, 0.0))
        said, right = [], found["verdict"] != "unexplained"
        for effect in found["effects"]:
            pairs = [
                (z[n, c], n) for n in names_of(effect) for c in effect["channels"] if (n, c) in z
            ]
            best = max(pairs, default=None)
            confirmed = best is not None and best[0] >= CONFIRMED
            right &= confirmed
            gain = effect["evidence"].get("held_out_gain")
            said.append(
                f"{effect['name']} {','.join(effect['channels'])} "
                f"({'not on the menu' if best is None else f'{best[1]} z {best[0]:.1f}'}, held out {gain})"
            )
        good += right
        print(
            f"{log.name:26s} {found['verdict']:16s} {'right' if right else 'NOT SHOWN':9s} {'; '.join(said)}"
        )
    print(f"answered rightly: {wilson(good, len(known))}")


def hidden(cases: Path, answers: Path, runs: Path, baseline: Path) -> None:
    """Shares of the hidden effects that are named, and of false further names."""
    text = answers.read_bytes()
    if hashlib.sha256(text).hexdigest() != (cases / "answers.sha256").read_text().strip():
        raise SystemExit(f"{answers}: not the answers that were sealed with {cases}")
    named = further = 0
    by_effect: dict[str, list[bool]] = {}
    listed = json.loads(text)["cases"]
    for case in listed:
        found = answer_of(runs / case["case"])
        before = answer_of(baseline / f"case-{case['log']}")
        known = {
            (n, t)
            for e in (before or {"effects": []})["effects"]
            for n in names_of(e)
            for t in triads_of(e)
        }
        effects_ = [] if found is None else found["effects"]
        hit = named_in(found, case)
        false = [
            e["name"]
            for e in effects_
            if case["effect"] not in names_of(e)
            and not any((n, t) in known for n in names_of(e) for t in triads_of(e))
        ]
        named += hit
        further += bool(false)
        by_effect.setdefault(case["effect"], []).append(hit)
        if not hit or false:
            said = "; ".join(
                f"{e['name']}|{'|'.join(e.get('alternatives', []))} on {','.join(e['channels'])}"
                for e in effects_
            )
            print(
                f"{case['case']} {case['log']:24s} {case['effect']:17s} {case['channel']:8s} z {case['z']:5.0f}  "
                f"{'named' if hit else 'MISSED'}; {None if found is None else found['verdict']}: {said}"
            )
    for name, hits in sorted(by_effect.items()):
        print(f"{name:20s} {wilson(sum(hits), len(hits))}")
    print(f"named in the set on its triad: {wilson(named, len(listed))}")
    print(f"cases with a false further name: {wilson(further, len(listed))}")


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path, nargs="?")
    parser.add_argument("--answers", type=Path)
    parser.add_argument("--runs", type=Path)
    parser.add_argument("--baseline", type=Path, help="runs of the unchanged logs")
    parser.add_argument("--as-they-are", type=Path)
    parser.add_argument("--fetched", type=Path)
    args = parser.parse_args()
    if args.as_they_are:
        as_they_are(
            args.as_they_are, logs.read_all(Path(os.environ["INERTIAX_RECORDINGS"]), args.fetched)
        )
    else:
        hidden(args.cases, args.answers, args.runs, args.baseline)


if __name__ == "__main__":
    main()
