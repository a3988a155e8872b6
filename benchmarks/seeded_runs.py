"""Runs of one seed each, kept as they end, so that a benchmark goes on where it stopped."""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path


def seeded_runs(doc: str | None, one: Callable[[int], dict]) -> list[dict]:
    """The rows `one(seed)` of the seeds that the command line asks for, and those kept before."""
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    rows: list[dict] = []
    if args.output is not None and args.output.exists():
        rows = [json.loads(line) for line in args.output.read_text().splitlines()]
    done = {row["seed"] for row in rows}
    for seed in range(args.first, args.first + args.runs):
        if seed in done:
            continue
        began = time.process_time()
        rows.append({"seed": seed, **one(seed), "seconds": time.process_time() - began})
        print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
        if args.output is not None:
            args.output.write_text("".join(json.dumps(r) + "\n" for r in rows))
    return rows
