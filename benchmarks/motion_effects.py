"""Effects of the rate in logs without a table: named by the motions between rests, or not claimed where there are none.

Simulated logs (NumPy and SciPy alone: `tests/turned_by_hand.py`, which knows no model of the package) hold nothing, or
one effect on one gyro; with INERTIAX_RECORDINGS imu_tk's Xsens log does, too, with the effect added to its own rates.
Printed for each: what was named, and by how many of its standard deviations the size is off.

    python benchmarks/motion_effects.py [--nulls 20] [--each 6] [--seed 0] [--sizes 0.003 0.006] [--real]
"""

import argparse
import os
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import numpy as np

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose.pipeline import diagnose_campaign


sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from turned_by_hand import log


def asymmetry(w: np.ndarray, axis: int) -> np.ndarray:
    """|ω|."""
    return np.abs(w[:, axis])


def quadratic(w: np.ndarray, axis: int) -> np.ndarray:
    """ω |ω|."""
    return w[:, axis] * np.abs(w[:, axis])


def cubic(w: np.ndarray, axis: int) -> np.ndarray:
    """ω³."""
    return w[:, axis] ** 3


def product(w: np.ndarray, axis: int) -> np.ndarray:
    """The product of the rates about the two other axes."""
    return w[:, (axis + 1) % 3] * w[:, (axis + 2) % 3]


HIDDEN = {
    asymmetry: "scale_asymmetry",
    quadratic: "rate_nonlinearity",
    cubic: "rate_nonlinearity",
    product: "cross_axis_rate",
}


def on(axis: int, shape: Callable, size: float) -> Callable[[np.ndarray], np.ndarray]:
    """An effect as an addition to all three outputs."""
    return lambda w: size * shape(w, axis)[:, None] * np.eye(3)[axis]


def answered(campaign: Campaign, shape: Callable, axis: int, size: float) -> tuple[str, float]:
    """ "named", "in the set", "other" or "nothing", and the error of the size in standard deviations."""
    found, _ = diagnose_campaign(campaign)
    mine = [e for e in found.effects if e.channels == (f"gyro_{'xyz'[axis]}",)]
    if not mine:
        return "nothing", np.nan
    name = HIDDEN[shape]
    if mine[0].name != name:
        return ("in the set" if name in mine[0].alternatives else "other"), np.nan
    values = [p for n, p in mine[0].parameters if n == "coefficient"]
    told = len(values) == 1 and values[0].std
    return "named", (values[0].value - size) / values[0].std if told else np.nan


def xsens() -> Campaign:
    """imu_tk's log in SI by the manufacturer's figures."""
    folder = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    accel, gyro = (np.loadtxt(folder / f"xsens_{k}.mat") for k in ("acc", "gyro"))
    rows = min(len(accel), len(gyro))
    made = Recording(
        time=accel[:rows, 0],
        accel=(accel[:rows, 1:] - 32768.0) / [415.0, 413.0, 415.0],
        gyro=(gyro[:rows, 1:] - 32768.0) / [4778.0, 4758.0, 4766.0],
        name="xsens",
    )
    return Campaign((made,), Site(gravity=9.81744))


def hidden_in(campaign: Campaign, added: Callable[[np.ndarray], np.ndarray]) -> Campaign:
    """The campaign with an effect of its own rates, less their median, on the gyros."""
    (recording,) = campaign.recordings
    rates = recording.gyro - np.median(recording.gyro, axis=0)
    one = eqx.tree_at(lambda r: r.gyro, recording, recording.gyro + added(rates))
    return eqx.tree_at(lambda c: c.recordings, campaign, (one,))


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--nulls", type=int, default=20)
    asked.add_argument("--each", type=int, default=6, help="runs of each effect and size")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--sizes", type=float, nargs="+", default=[0.003, 0.006])
    asked.add_argument("--real", action="store_true", help="in the Xsens log, too")
    options = asked.parse_args()
    rng = np.random.default_rng(options.seed)
    draw = lambda: int(rng.integers(2**31))
    alarms = sum(bool(diagnose_campaign(log(draw()))[0].effects) for _ in range(options.nulls))
    print(f"nothing hidden: {alarms} of {options.nulls} with a named effect", flush=True)
    errors: list[float] = []
    for size in options.sizes:
        for shape in HIDDEN:
            told: Counter[str] = Counter()
            for _ in range(options.each):
                axis = int(rng.integers(3))
                said, error = answered(log(draw(), on(axis, shape, size)), shape, axis, size)
                told[said] += 1
                errors.append(error)
            print(f"{shape.__name__} of {size:g}: {dict(told)}", flush=True)
    known = np.array([e for e in errors if np.isfinite(e)])
    inside = np.mean(np.abs(known) < 1.96) if len(known) else np.nan
    print(f"sizes: {len(known)} told, {100 * inside:.0f} % within their 95 % intervals")
    if options.real:
        for shape in HIDDEN:
            for axis in range(3):
                campaign = hidden_in(xsens(), on(axis, shape, max(options.sizes)))
                said, error = answered(campaign, shape, axis, max(options.sizes))
                print(
                    f"Xsens, {shape.__name__} on {'xyz'[axis]}: {said}, {error:+.1f} sigma",
                    flush=True,
                )


if __name__ == "__main__":
    main()
