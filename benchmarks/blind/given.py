"""Held-out residual of the diagnosis against that of a fit which is given the true effect.

    python benchmarks/blind/given.py CASES --answers answers.json --run RUNS/inertiax -o given.json

For every single effect with z of 10 or more the name and the channels are taken from the answers, and only the form and
setting of that effect are fitted; the same dwells are held out. The ratio of the two residuals is 1 where the
diagnosis chose as if it had known. Opens the answers: for use after the runs.
"""

import argparse
import json
from pathlib import Path

import jax
import numpy as np
from score import open_answers

from inertiax.data.campaign import load_campaign
from inertiax.diagnose.estimates.cross_validation import held_out_rms
from inertiax.diagnose.estimates.parameters import tune
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare, Prepared
from inertiax.diagnose.selection.evidence import bank, count_forms, judge


LEAST_Z = 9.9


def given(prepared: Prepared, name: str, channels: tuple[int, ...]) -> float | None:
    """Held-out rms of the triad with the named effect on those channels; `None` where the plan has no form."""
    forms = [
        t
        for t in prepared.candidates
        if t.name == name and (t.channels == channels or t.known.common)
    ]
    if not forms:
        return None
    noise = fit_noise(prepared.system)
    start = bank(prepared.system, [noise], [])
    ranked = judge(prepared.system, start, forms, [], count_forms(forms), None)
    if not ranked:
        return None
    best = max(ranked, key=lambda c: c.ratio).term
    term, _ = tune(prepared, fit_noise(prepared.system, [best], noise), best, [])
    return held_out_rms(prepared, [term])


def one(case: Path, run: Path, truth: dict) -> dict | None:
    """Both residuals of one case; `None` where the diagnosis reports on the other triad."""
    diagnosis = json.loads((run / "diagnosis.json").read_text())
    triad = truth["channels"][0].split("_")[0]
    channels = tuple("xyz".index(c[-1]) for c in truth["channels"])
    triads = prepare(load_campaign(case)).triads
    prepared = next(p for p in triads if p.form.triad == triad)
    fit = diagnosis["fit"]
    plain = held_out_rms(prepared, [])
    if not np.isclose(plain, fit["baseline"]["held_out_rms"], rtol=1e-6):
        return None
    known = given(prepared, truth["name"], channels)
    if known is None:
        return None
    said = fit["augmented"]["held_out_rms"]
    return {"baseline": plain, "diagnosis": said, "given": known, "ratio": said / known}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    made = []
    with jax.enable_x64(True):
        for answer in open_answers(args.cases, args.answers)["cases"]:
            if answer["kind"] != "single" or answer["effects"][0]["z"] < LEAST_Z:
                continue
            run = args.run / answer["case"]
            if not (run / "diagnosis.json").exists():
                continue
            found = one(args.cases / answer["case"], run, answer["effects"][0])
            if found is not None:
                made.append({"case": answer["case"], **found})
                print(answer["case"], f"{found['ratio']:.4f}", flush=True)
    ratios = np.array([m["ratio"] for m in made])
    summary = {
        "cases": len(made),
        "median": float(np.median(ratios)),
        "within 1.08": int((ratios <= 1.08).sum()),
        "largest": float(ratios.max()),
    }
    args.output.write_text(json.dumps({"summary": summary, "cases": made}, indent=1) + "\n")
    print(summary)


if __name__ == "__main__":
    main()
