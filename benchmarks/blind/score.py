"""Open the sealed answers and mark the runs.

    python benchmarks/blind/score.py CASES --answers answers.json \\
        --runs inertiax=RUNS --runs ols=RUNS-OLS -o results.json --page results.md

Refuses while a case has not been run, or if the answers are not those that were sealed.
"""

import argparse
import hashlib
import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np
import page
from generate import ARMS
from marks import Mark, mark


BINS = (3, 5, 6, 8, 10, 15, 30)


def wilson(hits: int, trials: int) -> list[float]:
    """95 % interval of a share, Wilson's score form."""
    if trials == 0:
        return [0.0, 1.0]
    z, p = 1.959964, hits / trials
    middle = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(p * (1 - p) / trials + z * z / (4 * trials**2))
    return [float(max(middle - half, 0)), float(min(middle + half, 1))]


def share(values) -> dict:
    """Hits, trials, share and Wilson interval of the values that are not None."""
    known = [bool(v) for v in values if v is not None]
    hits, n = sum(known), len(known)
    return {"hits": hits, "trials": n, "share": hits / n if n else None, "wilson": wilson(hits, n)}


def bin_of(z: float | None) -> int | None:
    """The drawn z nearest (in ratio) to the one in the plan."""
    return None if z is None else min(BINS, key=lambda b: abs(np.log(b / max(z, 1e-9))))


def summary(marks: list[Mark]) -> dict:
    """Every figure of one method over all cases."""
    of = lambda kind: [m for m in marks if m.kind == kind]
    singles = of("single")
    out = {
        "cases": dict(Counter(m.kind for m in marks)),
        "failed": sum(m.verdict == "failed" for m in marks),
        "false_alarm": share(not m.right_verdict for m in of("null")),
        "single": {},
        "double": {},
        "outside": {
            "unexplained": share(m.verdict == "unexplained" for m in of("open")),
            "misnamed": share(m.misnamed for m in of("open")),
            "missed": share(m.verdict == "consistent" for m in of("open")),
        },
        "aliased": _aliased(of("aliased")),
    }
    groups = {str(b): [m for m in singles if bin_of(m.z) == b] for b in BINS}
    groups["10 and more"] = [m for m in singles if (m.z or 0) >= 9.9]
    for label, group in groups.items():
        if group:
            out["single"][label] = _single(group)
    pairs = of("double")
    for label, low in (("all", 0.0), ("10 and more", 9.9)):
        out["double"][label] = share(m.both_found for m in pairs if (m.z or 0) >= low)
    out["covered"] = share(c for m in [*singles, *pairs] for c in m.covered)
    times = [m.seconds for m in marks if m.seconds is not None]
    out["seconds"] = {"median": _median(times), "longest": max(times) if times else None}
    return out


def _single(group: list[Mark]) -> dict:
    sizes = [m.set_size for m in group if m.set_size]
    seen = [m for m in group if m.detected]
    spans = [m.iou for m in group if m.iou is not None]
    named = [m for m in group if m.first_in_class]
    return {
        "detected": share(m.detected for m in group),
        "first_in_class": share(m.first_in_class for m in group),
        "true_in_set": share(m.true_in_set for m in group),
        "set_right": share(m.true_in_set for m in seen),
        "mean_set_size": float(np.mean(sizes)) if sizes else None,
        "channel": share(m.channel for m in seen),
        "span_overlap": share(x >= 0.7 for x in spans),
        "median_iou": _median(spans),
        "covered": share(c for m in group for c in m.covered),
        "held_out_ratio": _median([m.held_out_ratio for m in named if m.held_out_ratio]),
        "improvement_ratio": _median([m.improvement_ratio for m in named if m.improvement_ratio]),
    }


def _aliased(group: list[Mark]) -> dict:
    absorbed = [m for m in group if m.expected == "consistent"]
    sets = [m for m in group if m.expected != "consistent"]
    return {
        "abstained": share(m.right_verdict for m in absorbed),
        "first_in_class": share(m.first_in_class for m in sets),
        "answered_by_a_set": share(
            bool(m.true_in_set) and (m.set_size or 0) >= 2 for m in sets
        ),
    }  # fmt: skip


def _median(values) -> float | None:
    return float(np.median(values)) if len(values) else None


def confusion(marks: list[Mark], least_z: float = 6.0) -> dict[str, dict[str, int]]:
    """First name said for each true name, single effects of at least `least_z`."""
    table: dict[str, Counter] = {}
    for m in marks:
        if m.kind == "single" and (m.z or 0) >= least_z - 0.1:
            said = m.said[0] if m.said else m.verdict
            table.setdefault(m.true[0], Counter())[said] += 1
    return {name: dict(row) for name, row in sorted(table.items())}


def read_run(folder: Path) -> tuple[dict | None, float]:
    """The diagnosis of one run (None if it gave none) and its seconds."""
    run = json.loads((folder / "run.json").read_text())
    file = folder / "diagnosis.json"
    ok = run["status"] == 0 and file.exists()
    return (json.loads(file.read_text()) if ok else None), run["seconds"]


def unfinished(names: list[str], runs: dict[str, Path]) -> list[str]:
    """Cases that some method has not run."""
    return [f"{m}/{n}" for m, f in runs.items() for n in names if not (f / n / "run.json").exists()]


def open_answers(cases: Path, answers: Path) -> dict:
    """The answers, if they are the sealed ones."""
    text = answers.read_bytes()
    found = hashlib.sha256(text).hexdigest()
    sealed = (cases / "answers.sha256").read_text().strip()
    if found != sealed:
        sys.exit(f"{answers}: SHA-256 is {found}, but {sealed} was sealed with {cases}.")
    return json.loads(text)


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("--runs", action="append", required=True, metavar="NAME=FOLDER")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="Markdown page")
    parser.add_argument("--title", default="Blind proof", help="of that page")
    parser.add_argument("--given", type=Path, help="what `given.py` wrote for the first run")
    parser.add_argument("--informed", type=Path, help="what this script wrote for `informed.py`")
    parser.add_argument("--subset", action="store_true", help="mark what all the runs hold")
    parser.add_argument("--arms", nargs="*", choices=list(ARMS), help="mark these only")
    args = parser.parse_args()
    runs = {name: Path(folder) for name, folder in (r.split("=", 1) for r in args.runs)}
    answers = open_answers(args.cases, args.answers)
    marked = [a for a in answers["cases"] if not args.arms or a["kind"] in args.arms]
    if args.subset:
        marked = [a for a in marked if not unfinished([a["case"]], runs)]
    missing = unfinished([a["case"] for a in marked], runs)
    if missing:
        sys.exit(f"{len(missing)} runs are missing ({', '.join(missing[:3])} …); run them first.")
    results = {
        "seed": answers["seed"],
        "drawn": len(answers["cases"]),
        "sealed": (args.cases / "answers.sha256").read_text().strip(),
    }
    if args.given:
        results["given"] = json.loads(args.given.read_text())["summary"]
    if args.informed:
        results["informed"] = json.loads(args.informed.read_text())["methods"]
    results["methods"] = {}
    for name, folder in runs.items():
        marks = [mark(a, *read_run(folder / a["case"])) for a in marked]
        results["methods"][name] = {
            "summary": summary(marks), "confusion": confusion(marks), "marks": [asdict(m) for m in marks],
        }  # fmt: skip
    args.output.write_text(json.dumps(results, indent=1) + "\n")
    if args.page:
        args.page.write_text(page.markdown(results, args.title))


if __name__ == "__main__":
    main()
