"""Which of the hidden effects rests can tell at all: a search that knows the menu, but not where it acts.

    python ceiling.py CASES --answers sealed/answers.json [--fetched FETCHED] [--runs RUNS]

For each case every effect of the menu, each channel of the triad and each gap of a step are tried in turn by
generalised least squares of the rests beside the usual model (`regression.py`). Noise is white; in rows of one channel
a random walk adds to it in unknown proportion, since a bias may wander. The largest likelihood ratio is a name where
draws of the noise that is fitted without any effect have a larger one in fewer than `FALSE` / 2 of logs (two triads are
searched), and where the best single rest that may be off is not `SAME` times as likely: a hand may have held it.
"""

import argparse
import dataclasses
import json
import os
from pathlib import Path

import effects
import generate
import logs
import numpy as np
import regression
import rests
import score


FALSE = 0.05  # of logs, with a name that is none
SAME = 20.0  # likelihood ratio within which one explanation is as good as another
DRAWS = 300
WALKS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)  # variance of a step over the white one


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """What the usual model leaves of one triad's or channel's rests, and what may be in it."""

    residual: np.ndarray  # (row,), in the space that the model leaves
    names: list[tuple[str, int]]  # effect and axis of each column
    columns: np.ndarray  # (row, effect)
    single: np.ndarray  # (row, rest): one rest that is off
    noises: list[np.ndarray]  # Cholesky factors, one for each proportion of the walk

    def ratios(self, values: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Twice the gain of log likelihood by each column on each column of values, and the best noise without."""
        size = len(values)
        without, beside = [], []
        for factor in self.noises:
            y, c = np.linalg.solve(factor, values), np.linalg.solve(factor, columns)
            left = np.sum(y**2, axis=0)
            gained = (c.T @ y) ** 2 / np.sum(c**2, axis=0)[:, None]
            determinant = 2.0 * np.sum(np.log(np.diag(factor)))
            without.append(determinant + size * np.log(left))
            beside.append(determinant + size * np.log(np.maximum(left - gained, 1e-12 * left)))
        best = np.argmin(without, axis=0)
        return np.min(without, axis=0) - np.min(beside, axis=0), best


def rows_of(log: logs.Log, found: rests.Rests, triad: str, axis: int) -> Rows | None:
    """The rows of a channel; of accelerometers in several poses all channels share them."""
    base = regression.baseline(log, found, triad, axis)
    if base is None:
        return None
    fixed = base.columns / base.sigma[:, None]
    u, s, _ = np.linalg.svd(fixed, full_matrices=True)
    free = u[:, int(np.sum(s > 1e-10 * s[0])) :]
    start, names, columns = regression.drive(log, found, 0.0), [], []
    for a in [axis] if base.one_channel else range(3):
        shown = lambda x, a=a: base.direction[:, a] * x / base.sigma
        for name, shape in effects.menu(log, triad).items():
            gaps = 0.5 * (found.time[1:] + found.time[:-1]) if name == "bias_step" else [0.0]
            for moment in gaps[:: max(1, len(gaps) // 80)]:
                drive = dataclasses.replace(start, moment=float(moment))
                means = effects.over_rests(drive, shape, a, found)
                column, whole = free.T @ shown(means), shown(means - means.mean())
                if np.linalg.norm(column) > generate.LEAST_SHOWN * np.linalg.norm(whole):
                    names.append((name, a))
                    columns.append(column)
    number = np.arange(len(base.residual))
    walk = np.minimum(number[:, None], number[None, :]) / base.sigma[:, None] / base.sigma
    walk *= np.median(base.sigma) ** 2
    steps = WALKS if base.one_channel else WALKS[:1]
    whitened = [free.T @ (np.eye(len(number)) + q * walk) @ free for q in steps]
    single = free.T if not log.one_pose else free.T[:, :0]
    return Rows(
        free.T @ (base.residual / base.sigma),
        names,
        np.stack(columns, axis=1),
        single,
        [np.linalg.cholesky(v) for v in whitened],
    )


def judge(log: logs.Log, answer: dict, rng: np.random.Generator) -> dict:
    """Whether the search finds something on the triad, and whether the hidden effect is as likely as what it finds."""
    triad, found = answer["channel"].split("_")[0], rests.find(log)
    shared = triad == "accel" and not log.one_pose
    largest, best, truth, alone = np.zeros(DRAWS), 0.0, 0.0, 0.0
    for axis in [0] if shared else range(3):
        rows = rows_of(log, found, triad, axis)
        if rows is None:
            return {
                "chance": 1.0,
                "ratio": 0.0,
                "rests": len(found.time),
                "alone": 0.0,
                "truth": 0.0,
            }
        seen, noise = rows.ratios(rows.residual[:, None], rows.columns)
        factor = rows.noises[int(noise[0])]
        drawn = factor @ rng.standard_normal((len(factor), DRAWS))
        largest = np.maximum(largest, rows.ratios(drawn, rows.columns)[0].max(axis=0))
        mine = [r for r, (n, a) in zip(seen[:, 0], rows.names, strict=True)
                if n == answer["effect"] and f"{triad}_{'xyz'[a]}" == answer["channel"]]  # fmt: skip
        best, truth = max(best, float(seen.max())), max([truth, *mine])
        if rows.single.shape[1] and f"{triad}_{'xyz'[axis]}" == answer["channel"] or shared:
            alone = max(alone, float(rows.ratios(rows.residual[:, None], rows.single)[0].max()))
    chance = (1 + int(np.sum(largest >= best))) / (DRAWS + 1)
    return {
        "chance": chance,
        "ratio": best,
        "truth": truth,
        "alone": alone,
        "rests": len(found.time),
    }


def read(case: Path, log: logs.Log) -> logs.Log:
    """A case's log as `generate.py` wrote it."""
    rows = np.loadtxt(case / "log.csv", delimiter=",", skiprows=1)
    return dataclasses.replace(log, time=rows[:, 0], accel=rows[:, 1:4], gyro=rows[:, 4:7])


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("--fetched", type=Path)
    parser.add_argument("--runs", type=Path, help="what the tool said, to compare")
    parser.add_argument("--only", nargs="*", help="names of cases")
    args = parser.parse_args()
    recordings = Path(os.environ["INERTIAX_RECORDINGS"])
    known = {x.name: x for x in logs.read_all(recordings, args.fetched)}
    rng, told, named = np.random.default_rng(1), [], []
    for answer in json.loads(args.answers.read_text())["cases"]:
        name = answer["case"]
        said = None if args.runs is None else score.answer_of(args.runs / name)
        if (args.only and name not in args.only) or (args.runs is not None and said is None):
            continue
        seen = judge(read(args.cases / name, known[answer["log"]]), answer, rng)
        within = 2.0 * np.log(SAME)
        reasons = [
            ("noise does it", seen["chance"] >= 0.5 * FALSE),
            ("one rest does it", seen["alone"] > seen["ratio"] + within),
            ("another effect does it", seen["ratio"] > seen["truth"] + within),
        ]
        why = [reason for reason, so in reasons if so]
        told.append(not why)
        named.append(score.named_in(said, answer))
        print(
            f"{name} {answer['log']:24s} {answer['effect']:17s} {answer['channel']:8s} z {answer['z']:5.0f}  "
            f"{seen['rests']:3d} rests; ratio {seen['ratio']:6.1f}, of the hidden one {seen['truth']:6.1f}, of one "
            f"rest {seen['alone']:6.1f}; chance {seen['chance']:.3f} {', '.join(why)}{'' if named[-1] else ' MISSED'}",
            flush=True,
        )
    print(f"told: {score.wilson(sum(told), len(told))}")
    if args.runs is not None:
        both = sum(n and t for n, t in zip(named, told, strict=True))
        print(f"named by the tool: {score.wilson(sum(named), len(named))}")
        print(f"of what can be told: {score.wilson(both, sum(told))}")


if __name__ == "__main__":
    main()
