"""Outputs that a firmware has worked on: gyros held at one value while nothing moves, forces scaled to one length."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import AXES
from .dead_channels import lives, triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .samples import UNITS
from .thresholds import Thresholds


_FEWEST_ROWS = 100
_SELDOM = 0.8  # share of the other rows that stand there, too: ends of rests are among them


def check_processed_outputs(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Gyros whose zero no rest shows, and accelerometers whose norm none tells."""
    found = []
    for log in device.logs:
        for name, values in triads(log):
            if len(values) >= _FEWEST_ROWS:
                look = _one_value_at_rest if name == "gyro" else _one_length
                found += look(log, values, limits)
    return found


def held_at_rest(
    log: Log, values: Float[np.ndarray, "time 3"], limits: Thresholds
) -> dict[int, tuple[float, float]]:
    """Of each gyro that stands at one value at rest, but not in motion: that value, and its share of the rows there."""
    at_rest = log.at_rest
    if at_rest.sum() < _FEWEST_ROWS or at_rest.all():
        return {}
    held = {}
    for axis in range(3):
        resting, moving = values[at_rest, axis], values[~at_rest, axis]
        value = _middle(resting)
        share = float(np.mean(resting == value))
        if share > limits.held_at_rest and lives(moving) and np.mean(moving == value) < _SELDOM:
            held[axis] = (value, share)
    return held


def _one_value_at_rest(
    log: Log, values: Float[np.ndarray, "time 3"], limits: Thresholds
) -> list[Finding]:
    held = held_at_rest(log, values, limits)
    if not held:
        return []
    share = min(s for _, s in held.values())
    names = ", ".join(f"gyro_{AXES[k]}" for k in held)
    zero = all(value == 0.0 for value, _ in held.values())
    stand = (
        "zero" if zero else ", ".join(f"{v:.3g}" for v, _ in held.values()) + f" {UNITS['gyro']}"
    )
    cause = (
        "the firmware, or a coarse step, hides what they read there, and with it their biases. Switch off what holds "
        "small rates at zero, or give wider digits"
        if zero
        else "their step hides what they read there, and their biases are known to half of it. Take a finer range"
    )
    return [
        finding(
            "held_at_rest",
            "warning",
            "gyro",
            f"{log.name}: {names} {'read' if len(held) > 1 else 'reads'} exactly {stand} in {share:.0%} of the rows at "
            f"rest, but not in motion: {cause}.",
            share=share,
            axes=len(held),
        )
    ]


def _one_length(log: Log, values: Float[np.ndarray, "time 3"], limits: Thresholds) -> list[Finding]:
    """Three sensors that do not know of each other scatter in their norm as they do one by one."""
    told = log.over_rests("accel")
    if told is None or not len(told.std):
        return []
    norm = np.linalg.norm(values, axis=1)
    size, noise = float(np.median(norm)), float(np.median(told.std))
    spread = float(np.quantile(np.abs(norm - size), 0.99))
    if spread >= limits.one_length * noise:
        return []
    return [
        finding(
            "normalised",
            "warning",
            "accel",
            f"{log.name}: |a| is {size:.6g} {UNITS['accel']} to {spread:.1g} in 99 % of the rows, although each axis "
            f"scatters by {noise:.1g} at rest: these are directions, scaled to one length, and tell neither bias nor "
            "scale. Log the accelerometers' own outputs.",
            spread=spread,
            noise=noise,
        )
    ]


def _middle(x: Float[np.ndarray, " time"]) -> float:
    """The one value that more than half of the rows can have: their median."""
    return float(np.partition(x, len(x) // 2)[len(x) // 2])
