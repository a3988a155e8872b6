"""Effects hidden in other people's logs, with sealed answers; or the logs as they are.

    python generate.py --as-they-are -o CASES
    python generate.py --cases 200 --seed SEED -o CASES --answers sealed/answers.json

Imports nothing of the package under test. A case is a real log with one effect added to every row of one channel, in
closed form (`effects.py`), at 12 to 24 standard deviations beside the log's usual model by an ordinary regression of
its rests (`regression.py`), and rounded to the converter's steps where the log shows them.
"""

import argparse
import functools
import hashlib
import json
import os
from pathlib import Path

import effects
import logs
import numpy as np
import regression
import rests


Z_VALUES = (12.0, 16.0, 24.0)
NO_REST = {"accel": 0.03, "gyro": 0.02}  # m/s², rad/s: a log that the hand never lets rest
FEWEST_BLOCKS = 30  # of a log of one pose: fewer do not tell how slow its noise is
LEAST_SHOWN = 0.08  # of an effect's size that the model's parameters do not imitate


def converter_step(values: np.ndarray) -> float:
    """The step that all values are multiples of, apart from an offset; zero where none shows."""
    distinct = np.unique(values)
    if len(distinct) > 0.2 * len(values):
        return 0.0
    gaps = np.diff(distinct)
    step = float(gaps[gaps > 1e-9 * np.abs(distinct).max()].min())
    multiples = (distinct - distinct[0]) / step
    return step if np.abs(multiples - np.round(multiples)).max() < 0.02 else 0.0


def added_to(values: np.ndarray, addition: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A channel with an addition, on its converter's steps.

    What the first rounding took is drawn anew: readings that lie on the steps would pass a slope on as a staircase.
    """
    step = converter_step(values)
    if step == 0.0:
        return values + addition
    moved = values + addition + step * rng.uniform(-0.5, 0.5, len(values))
    return values[0] + step * np.round((moved - values[0]) / step)


def write(log: logs.Log, accel: np.ndarray, gyro: np.ndarray, folder: Path) -> None:
    """A campaign of canonical columns."""
    folder.mkdir(parents=True, exist_ok=True)
    columns = [log.time - log.time[0], *accel.T, *gyro.T]
    header = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
    if log.temperature is not None:
        columns.append(log.temperature)
        header += ",temperature"
    rows = np.stack(columns, axis=1)
    form = ["%.6f"] + ["%.9g"] * (rows.shape[1] - 1)
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=header, comments="", fmt=form)
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {log.gravity}\n\n[recordings]\nfiles = ["log.csv"]\n'
    )


@functools.cache
def judged(log: logs.Log, triad: str, axis: int) -> tuple[rests.Rests, regression.Baseline | None]:
    """The rests of a log, and what one channel is judged against."""
    found = rests.find(log)
    return found, regression.baseline(log, found, triad, axis)


def hide(
    log: logs.Log, name: str, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, dict] | None:
    """The effect in one channel; `None` where this draw does not show in this log."""
    triad = str(rng.choice(["accel", "gyro"]))
    axis = int(rng.integers(3))
    menu = effects.menu(log, triad)
    z = float(rng.choice(Z_VALUES)) * float(rng.choice([-1.0, 1.0]))
    if name not in menu:
        return None
    found, base = judged(log, triad, axis)
    if base is None or not log.one_pose and np.median(np.abs(base.sigma)) > NO_REST[triad]:
        return None
    if log.one_pose and len(found.time) < FEWEST_BLOCKS:
        return None
    inner = found.time[len(found.time) // 4 : 3 * len(found.time) // 4]
    moment = float(rng.choice(inner)) + 0.5 * float(np.median(np.diff(found.time)))
    drive = regression.drive(log, found, moment)
    shown = effects.over_rests(drive, menu[name], axis, found)
    _, _, white = regression.stands_out(base, shown, axis)
    whole = np.sqrt(np.sum((base.direction[:, axis] * (shown - shown.mean()) / base.sigma) ** 2))
    if not np.isfinite(white) or 1.0 / white < LEAST_SHOWN * whole:
        return None
    size = z * regression.smallest(base, shown, axis, rng)
    addition = size * menu[name](drive, axis)
    accel, gyro = log.accel.copy(), log.gyro.copy()
    target = accel if triad == "accel" else gyro
    target[:, axis] = added_to(target[:, axis], addition, rng)
    answer = {
        "log": log.name,
        "device": log.device,
        "effect": name,
        "channel": f"{triad}_{'xyz'[axis]}",
        "z": z,
        "size": size,
        "moment": moment if name == "bias_step" else None,
        "alternatives": [],
    }
    return accel, gyro, answer


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--as-they-are", action="store_true", help="every log once, nothing added")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--answers", type=Path)
    parser.add_argument("--fetched", type=Path, help="folder of `fetch.py`")
    args = parser.parse_args()
    if "INERTIAX_RECORDINGS" not in os.environ:
        parser.error("INERTIAX_RECORDINGS is not set: the folder of the recordings")
    known = logs.read_all(Path(os.environ["INERTIAX_RECORDINGS"]), args.fetched)
    if args.as_they_are:
        for log in known:
            write(log, log.accel, log.gyro, args.output / f"case-{log.name}")
        return
    if args.answers is None:
        parser.error("--answers: where the sealed answers go")
    answers = []
    rng = np.random.default_rng(args.seed)
    names = sorted(
        {name for log in known for t in ("accel", "gyro") for name in effects.menu(log, t)}
    )
    while len(answers) < args.cases:  # effects in turn, so that the rare ones are not
        log = known[int(rng.integers(len(known)))]
        hidden = hide(log, names[len(answers) % len(names)], rng)
        if hidden is None:
            continue
        accel, gyro, answer = hidden
        name = f"case-{len(answers) + 1:03d}"
        write(log, accel, gyro, args.output / name)
        answers.append({"case": name, **answer})
    text = json.dumps({"suite": "real", "seed": args.seed, "cases": answers}, indent=1).encode()
    args.answers.parent.mkdir(parents=True, exist_ok=True)
    args.answers.write_bytes(text)
    digest = hashlib.sha256(text).hexdigest()
    (args.output / "answers.sha256").write_text(digest + "\n")
    print(f"{len(answers)} cases, answers sealed: {digest}")


if __name__ == "__main__":
    main()
