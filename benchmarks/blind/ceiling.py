"""The ceiling: a diagnosis that knows the true noise covariance and every textbook form.

    python benchmarks/blind/ceiling.py --seed 11 --cases 80 -o RUNS-CEILING

Draws the cases again from the seed (so it is no blind method) and answers by generalised least
squares with the true Σ. What it misses, this plan and noise do not tell; it marks the scorer too.
"""

import argparse
import json
import time
from pathlib import Path

import draw
import generate
import linear
import numpy as np
import textbook
from scipy import stats


WHOLE = {"earth_rate", "pier_tilt", "table_axis_error", "gravity_error", "rate_scale_error"}
WHOLE |= {"table_misalignment"}


def candidates(case: draw.Case, triad: str) -> list[tuple[str, list[int], np.ndarray]]:
    """Name, channels and whitened visible columns of every form on every channel."""
    p, view = case.problems[triad], case.views[triad]
    out = []
    for name, form in textbook.forms(view):
        groups = [[0, 1, 2]] if name in WHOLE else [[0], [1], [2]]
        groups += [[0, 1, 2]] if name == "thermal_lag" else []
        for channels in groups:
            signal = form(channels)
            if name == "thermal_lag" and len(channels) == 3:
                signal = signal.sum(axis=-1, keepdims=True)
            reduced = np.stack([p.reduce(x) for x in np.moveaxis(signal, -1, 0)], -1)
            out.append((name, channels, reduced))
    edges = np.cumsum([x.shape[1] for _, _, x in out])[:-1]
    wide = p.project(p.whiten(np.concatenate([x for _, _, x in out], -1)))
    parts = np.split(wide, edges, axis=1)
    return [(n, c, x) for (n, c, _), x in zip(out, parts, strict=True)]


def gains(
    y: np.ndarray, found: list, given: np.ndarray
) -> list[tuple[float, int, str, list[int], int]]:
    """(BIC gain, rank, name, channels, index) of adding each candidate to those given."""
    q0 = linear.span(given) if given.shape[1] else np.zeros((len(y), 0))
    left = y - q0 @ (q0.T @ y)
    out = []
    for k, (name, channels, x) in enumerate(found):
        rest = x - q0 @ (q0.T @ x)
        size, before = np.linalg.norm(rest, axis=0), np.linalg.norm(x, axis=0)
        rest = rest[:, (before > 1e-9) & (size > 1e-3 * before)]
        if rest.shape[1] == 0:
            continue
        q = linear.span(rest)
        gain = float(np.sum((q.T @ left) ** 2))
        out.append((gain - q.shape[1] * np.log(len(y)), q.shape[1], name, channels, k))
    return out


def explain(case: draw.Case, triad: str) -> tuple[list[dict], bool]:
    """Named effects in order of evidence, and whether something remains unexplained."""
    p = case.problems[triad]
    y = p.visible(case.disturbance[triad])
    found = candidates(case, triad)
    given, effects = np.zeros((len(y), 0)), []
    for _ in range(3):
        ranked = gains(y, found, given)
        bic, rank, name, channels, k = max(ranked, key=lambda g: g[0])
        p_value = stats.chi2.sf(bic + rank * np.log(len(y)), rank)
        if p_value * len(found) > 0.02:
            break
        best: dict[str, float] = {}
        for g, _, n, c, _ in ranked:
            if set(c) & set(channels):
                best[n] = max(best.get(n, -np.inf), g)
        rivals = sorted(
            (n for n in best if n != name and bic - best[n] < 6), key=lambda n: -best[n]
        )
        effects.append(
            {"name": name, "channels": [f"{triad}_{'xyz'[c]}" for c in channels],
             "alternatives": rivals, "parameters": {}, "evidence": {"delta_bic": bic}}
        )  # fmt: skip
        given = np.concatenate([given, found[k][2]], 1)
    q = linear.span(given) if given.shape[1] else given
    left = y - q @ (q.T @ y)
    dof = len(y) - p.base.shape[1] - q.shape[1]
    return effects, bool(stats.chi2.sf(left @ left, dof) < 0.005)


def diagnose(case: draw.Case) -> dict:
    """`diagnosis.json` by the ceiling's rules: too many or unexplained remainders mean unexplained."""
    answers = [explain(case, t) for t in case.plan.triads]
    effects = sorted((e for a, _ in answers for e in a), key=lambda e: -e["evidence"]["delta_bic"])
    remainder = any(r for _, r in answers) or any(len(a) > 2 for a, _ in answers)
    verdict = "unexplained" if remainder else "missing-physics" if effects else "consistent"
    return {"schema": "inertiax.diagnosis/1", "verdict": verdict, "effects": effects, "where": []}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    kinds = generate.arms(args.cases, np.random.default_rng([args.seed, 0]))
    for index, kind in enumerate(kinds, start=1):
        out = args.output / f"case-{index:03d}"
        if (out / "run.json").exists():
            continue
        start = time.perf_counter()
        diagnosis = diagnose(draw.case(kind, np.random.default_rng([args.seed, index])))
        out.mkdir(parents=True, exist_ok=True)
        (out / "diagnosis.json").write_text(json.dumps(diagnosis) + "\n")
        seconds = round(time.perf_counter() - start, 2)
        (out / "run.json").write_text(json.dumps({"status": 0, "seconds": seconds}) + "\n")


if __name__ == "__main__":
    main()
