"""How often the 95 % limits of the noise terms hold, over simulated logs with some terms absent.

    python benchmarks/allan_coverage.py [--runs 150] [--json FILE]

Each log has 16 384 samples at 100 Hz, a ramp, and flicker noise by Kasdin's filter (Proc. IEEE 83 (1995) 802).
One sigma of a share of 0.95 over 150 logs is 0.018.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.signal import fftconvolve

from inertiax.allan import identify


RATE, SIZE, RAMP = 100.0, 1 << 14, 2e-6
CASES = ((1e-3, 5e-4, 3e-4), (1e-3, 0.0, 3e-4), (1e-3, 5e-4, 0.0), (1e-3, 0.0, 0.0))


def log_of(
    rng: np.random.Generator, terms: tuple[float, float, float], response: np.ndarray
) -> np.ndarray:
    """A log with N, B, K and the ramp; the start of the flicker filter is forgotten."""
    flicker = fftconvolve(rng.normal(size=2 * SIZE), response)[SIZE : 2 * SIZE]
    white = rng.normal(size=SIZE) * np.sqrt(RATE)
    walk = np.cumsum(rng.normal(size=SIZE)) / np.sqrt(RATE)
    ramp = RAMP * np.arange(SIZE) / RATE
    return terms[0] * white + terms[1] * flicker + terms[2] * walk + ramp


def coverage(
    terms: tuple[float, float, float], runs: int, response: np.ndarray
) -> dict[str, float]:
    """Share of logs in which each term's limits hold its truth."""
    rng, truth = np.random.default_rng(4), dict(zip("NBKR", (*terms, RAMP)))
    inside = dict.fromkeys(truth, 0)
    for _ in range(runs):
        found = identify(log_of(rng, terms, response), rate=RATE).terms
        for name, true in truth.items():
            inside[name] += found[name].lower <= true <= found[name].upper
    return {name: count / runs for name, count in inside.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=150)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    k = np.arange(1, 2 * SIZE)
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    rows = []
    for terms in CASES:
        shares = coverage(terms, arguments.runs, response)
        rows.append({"N, B, K": terms, **shares})
        print(terms, "  ".join(f"{name} {share:.2f}" for name, share in shares.items()), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
