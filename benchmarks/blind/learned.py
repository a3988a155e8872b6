"""What a diagnosis can see that is told which effect to look for and where, but has to learn the noise.

    python benchmarks/blind/learned.py CASES --answers answers.json -o learned.json

For every single effect the likelihood ratio of its own best form on its own channels is taken, the variances fitted
anew with and without it, and counted as seen below the chance that the gate leaves one effect on one channel; "seen
loosely" is at 5 %, the whole share of false alarms that is allowed. z is measured
with the true variances; where an effect looks like slow noise, fitted variances take most of it up, in
any method that learns the noise from the same recording. Opens the answers: for use after the runs.

The channels of a triad tell each other's noise as they do in the diagnosis; `--alone` leaves each channel to itself.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import scipy.stats
from score import open_answers

from inertiax.data.campaign import load_campaign
from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.noise.pooled_channels import alike
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import finer, prepare, Prepared
from inertiax.diagnose.selection.evidence import bank, Candidate, judge, refine
from inertiax.diagnose.selection.forward import GATE
from inertiax.diagnose.selection.multiple_testing import family


LEAST_Z = 6.0
LOOSE = 0.05  # a gate that spends all alarms that are allowed on this one test
REFITTED = 8  # forms beside which the variances are fitted anew


def best_form(prepared: Prepared, forms: list[Term]) -> tuple[Candidate, float] | None:
    """The form with the largest likelihood ratio, and its chance among the forms of this one effect."""
    system = prepared.system
    start = bank(system, [fit_noise(system)], [])
    ranked = sorted(judge(system, start, forms, [], {}, None), key=lambda c: -c.ratio)
    if not ranked:
        return None
    near = [*forms, *finer(prepared, ranked[0].term)]
    fuller = refine(system, start, ranked[:REFITTED], [], most=REFITTED)
    found = judge(system, fuller, near, [], {}, None)
    best = max(found, key=lambda c: c.ratio)
    alone = family([c.score for c in found], [len(y) for y in system.base.observed])
    single = scipy.stats.chi2.sf(max(best.ratio, 0.0), best.score.size)
    tests = sum(c.at(best.ratio) for c in alone.groups.values())
    return best, float(-np.expm1(tests * np.log1p(-min(single, 1 - 1e-12))))


def one(case: Path, truth: dict, alone: bool) -> dict | None:
    """Ratio and chance of the true effect on its own channels; `None` where the plan has no form of it."""
    triad = truth["channels"][0].split("_")[0]
    channels = tuple("xyz".index(c[-1]) for c in truth["channels"])
    triads = prepare(load_campaign(case)).triads
    prepared = next(p for p in triads if p.form.triad == triad)
    if not alone:
        system = prepared.system
        prepared = replace(prepared, system=alike(system, fit_noise(system)))
    listed = [t for t in prepared.candidates if t.effect is not None]
    forms = [
        t
        for t in listed
        if t.name == truth["name"] and (t.known.common or t.channels == channels[:1])
    ]
    found = best_form(prepared, forms) if forms else None
    if found is None:
        return None
    best, chance = found
    groups = len({(t.name, t.channels) for t in listed})
    return {
        "name": truth["name"], "z": truth["z"], "form": best.term.variant.label,
        "ratio": best.ratio, "chance": chance, "effects": groups, "seen": chance * groups < GATE,
        "seen_loosely": chance * groups < LOOSE,
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument(
        "--alone", action="store_true", help="each channel tells its own noise only"
    )
    args = parser.parse_args()
    made = []
    with jax.enable_x64(True):
        for answer in open_answers(args.cases, args.answers)["cases"]:
            truth = answer["effects"][0] if answer["kind"] == "single" else None
            if truth is None or truth["z"] < LEAST_Z:
                continue
            found = one(args.cases / answer["case"], truth, args.alone)
            unseen = {"name": truth["name"], "z": truth["z"], "seen": False, "seen_loosely": False}
            made.append({"case": answer["case"], **(found or unseen)})
            print(made[-1], flush=True)
    summary = {
        label: {
            "cases": len(mine),
            "seen": sum(m["seen"] for m in mine),
            "seen_loosely": sum(m["seen_loosely"] for m in mine),
        }
        for label, mine in (
            ("6", [m for m in made if m["z"] < 7]),
            ("8", [m for m in made if 7 <= m["z"] < 9.9]),
            ("10 and more", [m for m in made if m["z"] >= 9.9]),
        )
    }
    args.output.write_text(json.dumps({"summary": summary, "cases": made}, indent=1) + "\n")
    print(summary)


if __name__ == "__main__":
    main()
