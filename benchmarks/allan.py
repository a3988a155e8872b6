"""Allan deviations of ten million samples, beside allantools, and how nearly they are equal.

    python benchmarks/allan.py [--json FILE]

Both compute the same 21 averaging factors (powers of two) in one process; the log is white noise with random walk.
In five runs on two busy cores: oadev 1.3 to 3.0, mdev 1.7 to 2.6, ohdev 2.2 to 5.2 and totdev 2.7 to 10 times as
quick, and equal to 7e-13.
"""

import argparse
import json
import time
from pathlib import Path

import allantools
import numpy as np

from inertiax.allan import deviations


SAMPLES, RATE = 10_000_000, 100.0
KINDS = ("oadev", "mdev", "ohdev", "totdev")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    rng = np.random.default_rng(0)
    log = rng.normal(size=SAMPLES) + 1e-4 * np.cumsum(rng.normal(size=SAMPLES))
    factors = 2 ** np.arange(21)
    rows = []
    for kind in KINDS:
        started = time.perf_counter()
        ours = deviations(log, rate=RATE, kind=kind, factors=factors)
        own = time.perf_counter() - started
        started = time.perf_counter()
        theirs = getattr(allantools, kind)(log, rate=RATE, data_type="freq", taus=factors / RATE)
        other = time.perf_counter() - started
        apart = float(np.max(np.abs(ours.deviation / theirs[1] - 1.0)))
        rows.append({"kind": kind, "seconds": own, "allantools": other, "apart": apart})
    print(f"{SAMPLES:,} samples, {len(factors)} averaging factors")
    print(f"{'':8}{'inertiax':>10}{'allantools':>12}{'greatest difference':>22}")
    for row in rows:
        print(
            f"{row['kind']:8}{row['seconds']:9.2f} s{row['allantools']:11.2f} s{row['apart']:22.1e}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
