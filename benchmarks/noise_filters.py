"""How right N is, and how often its 95 % limits hold, on logs behind a low-pass filter, held and rounded.

    python benchmarks/noise_filters.py [--quick] [--logs 200] [--cases TEXT] [--json FILE]

A sensor runs at eight times the log's rate with white noise, its filter (first order, or Butterworth of second) acts
there, and every eighth sample is logged; the truth is the log's density near zero frequency, aliases included. There is
no flicker and no random walk, so that each B or K that shows is false. Logs are of five minutes at 200 Hz.
Nothing of the package makes them. `--quick` takes 40 logs of the hardest cases.

A share of 0.95 over 200 logs has one sigma of 0.015.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfilt, sosfreqz

from inertiax.allan import identify


RATE, SAMPLES, OVERSAMPLED = 200.0, 60_000, 8
DENSITY = 1e-4  # rad/s/√Hz, of the sensor before the filter
SETTLING = 4000  # samples of the log that are thrown away
CORNERS = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # of the log's Nyquist frequency


class Case(NamedTuple):
    """One kind of log."""

    name: str
    order: int = 0  # of the filter; 0: none
    corner: float = 1.0  # of the Nyquist frequency
    held: float = 1.0  # rows to a sample
    step: float = 0.0  # of rounding, in standard deviations of the output


def cases() -> Iterator[Case]:
    yield Case("no filter")
    for order in (1, 2):
        for corner in CORNERS:
            yield Case(f"order {order}, corner {corner:g}", order, corner)
    yield Case("order 1, corner 0.4, each sample twice", 1, 0.4, held=2.0)
    yield Case("no filter, each sample three times", held=3.0)
    yield Case("no filter, 200 Hz read at 300 Hz", held=1.5)
    yield Case("no filter, steps of one sigma", step=1.0)
    yield Case("order 2, corner 0.2, steps of half a sigma", 2, 0.2, step=0.5)


QUICK = ("no filter", "order 1, corner 0.05", "order 2, corner 0.05", "order 2, corner 1", "twice")


def log_of(rng: np.random.Generator, case: Case) -> tuple[np.ndarray, float]:
    """Rows of a log, and the density of its noise near zero frequency."""
    log, density = _filtered(rng, case)
    if case.held != 1.0:
        log = log[(np.arange(int(len(log) * case.held)) / case.held).astype(int)]
    if case.step:
        step = case.step * np.std(log)
        log = step * np.round((log + 0.3 * step) / step)
    return log, density


def _filtered(rng: np.random.Generator, case: Case) -> tuple[np.ndarray, float]:
    if not case.order:
        return DENSITY * np.sqrt(RATE) * rng.standard_normal(SAMPLES), DENSITY
    sections = butter(case.order, case.corner / OVERSAMPLED, output="sos")
    white = rng.standard_normal((SAMPLES + SETTLING) * OVERSAMPLED)
    log = DENSITY * np.sqrt(RATE * OVERSAMPLED) * sosfilt(sections, white)
    # What the filter passes at multiples of the log's rate comes down to zero frequency.
    folded = np.arange(OVERSAMPLED // 2 + 1) * 2.0 * np.pi / OVERSAMPLED
    power = np.square(np.abs(sosfreqz(sections, worN=folded)[1]))
    total = power[0] + 2.0 * power[1:-1].sum() + power[-1]
    return log[SETTLING * OVERSAMPLED :: OVERSAMPLED], DENSITY * float(np.sqrt(total))


def shares(case: Case, logs: int) -> dict[str, object]:
    """What becomes of so many logs of one kind."""
    errors, inside, false, none = [], 0, 0, 0
    for seed in range(logs):
        rng = np.random.default_rng([seed, int(100 * case.corner), case.order])
        log, density = log_of(rng, case)
        terms = identify(log, rate=RATE * case.held).terms
        white = terms["N"]
        false += terms["B"].shown or terms["K"].shown
        if white.value is None:
            none += 1
            continue
        errors.append(white.value / density - 1.0)
        inside += white.lower <= density <= white.upper
    size = np.abs(errors)
    return {
        "case": case.name,
        "logs": logs,
        "covered": inside / max(len(errors), 1),
        "within_5_percent": float(np.mean(size < 0.05)),
        "bias": float(np.mean(errors)),
        "rms": float(np.sqrt(np.mean(np.square(errors)))),
        "false_B_or_K": false / logs,
        "no_value": none / logs,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="40 logs of the hardest cases")
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--cases", default="", help="only those whose name holds this text")
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    logs = 40 if arguments.quick else arguments.logs
    chosen = [c for c in cases() if arguments.cases in c.name]
    if arguments.quick:
        chosen = [c for c in chosen if any(c.name == q or c.name.endswith(q) for q in QUICK)]
    print(
        f"{'':44}{'N covered':>10}{'within 5 %':>11}{'bias':>9}{'rms':>8}{'false B, K':>11}{'none':>6}"
    )
    rows = []
    for case in chosen:
        row = shares(case, logs)
        rows.append(row)
        print(
            f"{case.name:44}{row['covered']:10.3f}{row['within_5_percent']:11.3f}{row['bias']:9.4f}"
            f"{row['rms']:8.4f}{row['false_B_or_K']:11.3f}{row['no_value']:6.2f}",
            flush=True,
        )
        if arguments.json:
            arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
