"""Diagnose cases with the noise of their type, learned from the units of `siblings.py`.

    python benchmarks/blind/informed.py CASES --units UNITS -o RUNS-INFORMED --part 1/2

As `inertiax learn-noise UNITS/CASE/unit-*` and `inertiax diagnose CASE --noise ...`, without report, in one process;
with `--consistent` as with that option of `learn-noise`.
Resumable; never opens the answers.
"""

import argparse
import json
import time
from pathlib import Path

from inertiax.cli.environment import prepare


def diagnosed(case: Path, units: list[Path], out: Path, consistent: bool) -> dict:
    """Status, seconds of learning and of the diagnosis, and the units that were left out."""
    from inertiax.data.campaign import load_campaign
    from inertiax.diagnose import diagnose, learn_noise, write_noise

    start = time.perf_counter()
    try:
        campaigns = [(u.name, load_campaign(u)) for u in units]
        noise = learn_noise(campaigns, consistent=consistent)
        write_noise(noise, out / "type-noise.json")
        learned = time.perf_counter()
        diagnose(load_campaign(case), noise=noise).save(out / "diagnosis.json")
    except Exception as problem:  # a wrong answer, to be counted as one
        said = " ".join(f"{type(problem).__name__}: {problem}".split())[:800]
        return {"status": 1, "seconds": time.perf_counter() - start, "stderr": said}
    return {
        "status": 0, "seconds": round(time.perf_counter() - learned, 2),
        "learning": round(learned - start, 2), "left_out": [list(x) for x in noise.left_out],
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--units", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--consistent", action="store_true", help="do not diagnose the units first")
    parser.add_argument("--part", default="1/1", help="K/N: every N-th case from the K-th on")
    args = parser.parse_args()
    prepare()  # before JAX is imported
    part, parts = map(int, args.part.split("/"))
    for folder in sorted(args.units.glob("case-*"))[part - 1 :: parts]:
        out = args.output / folder.name
        if (out / "run.json").exists():
            continue
        out.mkdir(parents=True, exist_ok=True)
        units = sorted(folder.glob("unit-*"))
        found = diagnosed(args.cases / folder.name, units, out, args.consistent)
        (out / "run.json").write_text(json.dumps(found) + "\n")
        print(f"{folder.name}: {found}", flush=True)


if __name__ == "__main__":
    main()
