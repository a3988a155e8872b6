"""How much of each concealed effect is left in the rows of the diagnosis, were the true noise known.

    python benchmarks/blind/kept.py CASES --answers answers.json -o kept.json --least 6 --most 15

z of the true signature in the package's own rows under the true variances, beside the generator's z: a gap is lost
before any noise is learned, by rows left out or by a noise model that does not hold what the channels share. Opens
the answers: for use after the runs.
"""

import argparse
import json
from pathlib import Path

import draw
import jax
import numpy as np
from score import open_answers
from world import PROBE_SHARE, RELAXATIONS

from inertiax.data.campaign import load_campaign
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.noise.state_space import TIME_CONSTANTS
from inertiax.diagnose.problem import prepare, Prepared
from inertiax.diagnose.selection.score_test import whiten_columns


def true_variances(case: draw.Case, triad: str, chains: int) -> list[np.ndarray]:
    """The generator's noise in the package's components; its five relaxations are shared out over six.

    One set for each chain of rows; where there is one, the channels' mean.
    """
    noise, share = case.noise[triad], len(RELAXATIONS) / len(TIME_CONSTANTS)
    squares = [noise.flicker**2 * share, noise.walk**2, noise.dwell**2, noise.session**2]
    rest = [PROBE_SHARE**2 / 2.0, case.level["rig"] ** 2]
    own = [np.array([1.0, *(x[c] for x in squares), *rest]) for c in range(3)]
    return own if chains == 3 else [np.mean(own, axis=0)]


def left(prepared: Prepared, signal: np.ndarray, variances: list[np.ndarray]) -> float:
    """Length of the whitened rows of a signature, (sample, 3), with the calibration projected out."""
    system, total = prepared.system, 0.0
    rows = prepared.blocks.mean(signal)
    theta = tuple(np.log(v / scale) for v, scale in zip(variances, system.scales))
    noise = NoiseFit(theta, tuple(0.0 for _ in theta))
    for c, frame in enumerate(system.frames):
        alone = len(system.chains) == 1
        column = (rows * system.base.loads[0]).sum(axis=1) if alone else rows[:, c]
        white = whiten_columns(system, noise, c, np.concatenate([column[:, None], frame], axis=1))
        q, _ = np.linalg.qr(white[:, 1:])
        rest = white[:, 0] - q @ (q.T @ white[:, 0])
        total += float(rest @ rest)
    return total**0.5


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--least", type=float, default=6.0)
    parser.add_argument("--most", type=float, default=15.0)
    args = parser.parse_args()
    answers, made = open_answers(args.cases, args.answers), []
    with jax.enable_x64(True):
        for answer in answers["cases"]:
            z = answer["effects"][0]["z"] if answer["kind"] == "single" else 0.0
            if not args.least - 0.1 <= z <= args.most + 0.1:
                continue
            index = int(answer["case"].split("-")[1])
            rng = np.random.default_rng([answers["seed"], index])
            case = draw.case("single", rng, answers["sizes"])
            (drawn,) = case.drawn
            triad = drawn.effect.triad
            triads = prepare(load_campaign(args.cases / answer["case"]), ()).triads
            mine = next(p for p in triads if p.form.triad == triad)
            variances = true_variances(case, triad, len(mine.system.chains))
            seen = left(mine, drawn.signal, variances)
            made.append({
                "case": answer["case"], "plan": answer["plan"], "estimator": mine.form.estimator,
                "name": drawn.effect.name, "z": z, "kept": round(seen, 2),
            })  # fmt: skip
            print(made[-1], flush=True)
    shares = np.array([m["kept"] / m["z"] for m in made])
    low = sum(shares < 0.9)
    summary = {"cases": len(made), "median": float(np.median(shares)), "below 0.9": int(low)}
    args.output.write_text(json.dumps({"summary": summary, "cases": made}, indent=1) + "\n")
    print(summary)


if __name__ == "__main__":
    main()
