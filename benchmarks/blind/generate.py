"""Concealed cases: campaigns with a known omission, and their sealed answers.

    python benchmarks/blind/generate.py --cases 40 --seed 7 -o CASES --answers answers.json

Imports nothing of the package under test. The SHA-256 of the answers is printed and written beside
the cases before anything is analysed; the answers themselves go elsewhere.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import draw
import numpy as np
import writer


ARMS = {"null": 0.25, "single": 0.40, "double": 0.15, "open": 0.10, "aliased": 0.10}


def arms(count: int, rng: np.random.Generator) -> list[str]:
    """The arm of every case: exact shares as far as `count` allows, in random order."""
    shares = np.array(list(ARMS.values())) * count
    numbers = np.floor(shares).astype(int)
    for k in np.argsort(numbers - shares)[: count - numbers.sum()]:
        numbers[k] += 1
    out = [name for name, n in zip(ARMS, numbers, strict=True) for _ in range(n)]
    return list(rng.permutation(out))


def seal(answers: dict) -> tuple[bytes, str]:
    """The answers as bytes and their SHA-256."""
    text = json.dumps(answers, indent=1, sort_keys=True).encode()
    return text, hashlib.sha256(text).hexdigest()


def write_case(seed: int, folder: Path, sizes: Sequence[float], index: int, kind: str) -> dict:
    """Draw and write one case, which depends on nothing but the seed, its number and the sizes; return its answer."""
    name = f"case-{index:03d}"
    case = draw.case(kind, np.random.default_rng([seed, index]), sizes)
    writer.write(case, folder / name)
    print(f"\r{name} {case.plan.name}      ", end="", file=sys.stderr)
    return {"case": name, **draw.answer(case)}


def generate(
    count: int,
    seed: int,
    folder: Path,
    *,
    kinds: list[str] | None = None,
    sizes: Sequence[float] = draw.Z_VALUES,
    processes: int = 1,
) -> dict:
    """Write `count` cases to `folder` and return the answers."""
    kinds = kinds or arms(count, np.random.default_rng([seed, 0]))
    one, numbers = partial(write_case, seed, folder, sizes), range(1, len(kinds) + 1)
    if processes == 1:
        answers = list(map(one, numbers, kinds))
    else:
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
            answers = list(pool.map(one, numbers, kinds))
    print(file=sys.stderr)
    return {"suite": "blind", "seed": seed, "sizes": list(sizes), "cases": answers}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the cases")
    parser.add_argument("--answers", type=Path, required=True, help="where the sealed answers go")
    parser.add_argument("--kinds", nargs="*", choices=list(ARMS), help="arms to use, in turn")
    parser.add_argument(
        "--sizes", nargs="*", type=float, default=draw.Z_VALUES, help="z of single effects"
    )
    parser.add_argument("--processes", type=int, default=1, help="cases drawn side by side")
    args = parser.parse_args()
    if args.output.resolve() in args.answers.resolve().parents:
        sys.exit(f"--answers {args.answers} lies inside {args.output}; put it elsewhere.")
    args.output.mkdir(parents=True, exist_ok=True)
    kinds = [args.kinds[k % len(args.kinds)] for k in range(args.cases)] if args.kinds else None
    answers = generate(
        args.cases, args.seed, args.output, kinds=kinds, sizes=args.sizes, processes=args.processes
    )
    text, digest = seal(answers)
    (args.output / "answers.sha256").write_text(digest + "\n")
    args.answers.parent.mkdir(parents=True, exist_ok=True)
    args.answers.write_bytes(text)
    print(f"SHA-256 of the answers: {digest}")


if __name__ == "__main__":
    main()
