"""Claim: an effect of the audited size is detected in about nine recordings of ten.

Campaigns written in plain NumPy: a tumble (accelerometers, K2 on y) and a temperature sweep (gyros, a bias
step on x in the middle), with white noise and slow noise as in tests/test_diagnose.py. The audit sees one
campaign without the effect; the same size is then put into fresh ones and each is diagnosed in full. Bounds:
the same recordings without the effect (false alarms), and half the size.

    python benchmarks/detectable_size.py [NUMBER] [JSON]

Measured with 12 seeds each on two shared cores, K2 on accel_y: none 1/12, half the size 2/12, the audited size
(24.7 µg/g²) 10/12 detected (95 %: 0.55…0.95), each time with the right name.
"""

import json
import math
import sys
import time
from pathlib import Path

import jax


sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from inertiax.diagnose import audit, diagnose
from test_diagnose import only, sweep, tumble  # pyright: ignore[reportMissingImports]


def cases():
    """Name, campaign of a seed and a size, and the catalogue's name with the channel."""

    def k2(seed, size):
        return tumble(seed=seed, effect=lambda f, t: only(1, size * f[:, 1] ** 2))

    def step(seed, size):
        return sweep(seed=seed, effect=lambda probe, t: only(0, size * (t > 2500.0)))

    return (
        ("K2 on accel_y", k2, "second_order", "accel_y"),
        ("step on gyro_x", step, "bias_step", "gyro_x"),
    )


def wilson(hits, number):
    """95 % interval of a rate."""
    p, z = hits / number, 1.96
    centre = (p + z * z / (2 * number)) / (1 + z * z / number)
    half = z * math.sqrt(p * (1 - p) / number + z * z / (4 * number**2)) / (1 + z * z / number)
    return max(0.0, centre - half), min(1.0, centre + half)


def main(number, path):
    jax.config.update("jax_enable_x64", True)
    rows = []
    for title, campaign, name, channel in cases():
        plan = audit(campaign(1000, 0.0), estimate_noise=True)
        (size,) = [d.size for d in plan.detectable if d.name == name and d.channels == (channel,)]
        for factor in (0.0, 0.5, 1.0):
            start, detected, named = time.perf_counter(), 0, 0
            for seed in range(number):
                found = diagnose(campaign(2000 + seed, factor * size))
                detected += found.verdict != "consistent"
                named += any(name in (e.name, *e.alternatives) for e in found.effects)
            low, high = wilson(detected, number)
            seconds = (time.perf_counter() - start) / number
            rows.append(
                {"case": title, "audited_size": size, "times": factor, "number": number,
                 "detected": detected / number, "interval": [low, high], "named": named / number,
                 "seconds_each": seconds}
            )  # fmt: skip
            print(
                f"{title:16s} {factor:3.1f} x {size:.3g}: detected {detected}/{number} "
                f"(95 %: {low:.2f}…{high:.2f}), name in the set {named}/{number}, {seconds:.1f} s each",
                flush=True,
            )
    if path is not None:
        path.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 40,
        Path(sys.argv[2]) if len(sys.argv) > 2 else None,
    )
