"""Other units of the same type for some cases: what a fleet tells of the noise.

    python benchmarks/blind/siblings.py CASES --answers answers.json -o UNITS --z 6 --nulls 20

Each chosen case gets units of its own type on its own plan and station, which lack nothing: own parameters, own
noise drawn anew, each kind of it a little larger or smaller (`draw.UNIT_SCATTER`). Chosen are the single effects of
the sizes named and the first null campaigns; the answers are opened for that alone. Imports nothing of the package.
"""

import argparse
import sys
from pathlib import Path

import draw
import numpy as np
import writer
from score import bin_of, open_answers


def chosen(answers: dict, sizes: list[int], nulls: int) -> list[dict]:
    """Answers of the cases that get siblings."""
    cases = answers["cases"]
    singles = [c for c in cases if c["kind"] == "single" and bin_of(c["effects"][0]["z"]) in sizes]
    empty = [c for c in cases if c["kind"] == "null"][:nulls]
    return sorted(singles + empty, key=lambda c: c["case"])


def write_units(answers: dict, answer: dict, folder: Path, units: int):
    """Write the siblings of one case, which depend on nothing but the seed, the sizes and the case's number."""
    index = int(answer["case"].split("-")[1])
    if (folder / answer["case"] / f"unit-{units}" / "campaign.toml").exists():
        return
    seed, sizes = answers["seed"], answers["sizes"]
    case = draw.case(answer["kind"], np.random.default_rng([seed, index]), sizes)
    for k in range(1, units + 1):
        unit = draw.sibling(case, np.random.default_rng([seed, index, k]))
        writer.write(unit, folder / answer["case"] / f"unit-{k}")


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the units")
    parser.add_argument("--z", type=int, nargs="*", default=[6], help="sizes of single effects")
    parser.add_argument("--nulls", type=int, default=20)
    parser.add_argument("--units", type=int, default=4, help="of each type")
    args = parser.parse_args()
    answers = open_answers(args.cases, args.answers)
    for answer in chosen(answers, args.z, args.nulls):
        write_units(answers, answer, args.output, args.units)
        print(f"\r{answer['case']}", end="", file=sys.stderr)
    print(file=sys.stderr)


if __name__ == "__main__":
    main()
