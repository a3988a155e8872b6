"""A diagnosing process that stays: reads `CASE<tab>FOLDER` lines, answers each with one line.

Started by `run.py --together`. The answer is what `inertiax diagnose` writes, without report and figures; imports
and compiled programs are paid for once.
"""

import sys
import time
from pathlib import Path

from inertiax.cli.environment import prepare


def main():
    prepare()  # before JAX is imported
    from inertiax.diagnose.pipeline import run_diagnosis

    for line in sys.stdin:
        case, out = line.rstrip("\n").split("\t")
        start = time.process_time()
        try:
            run_diagnosis(Path(case), Path(out))
            print(f"0\t{time.process_time() - start:.2f}\t", flush=True)
        except Exception as problem:  # a wrong answer, to be counted as one
            said = " ".join(f"{type(problem).__name__}: {problem}".split())[:800]
            print(f"1\t{time.process_time() - start:.2f}\t{said}", flush=True)


if __name__ == "__main__":
    main()
