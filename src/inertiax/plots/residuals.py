"""Residuals before and after the named effects, against what drives them."""

import numpy as np
from jaxtyping import Float

from ..calibration.quantities import DEG_PER_HOUR
from ..diagnose.residuals import Residuals, TURN
from .style import Axes, COLOURS, Figure, INK, legend_above, MARKERS, new_figure, QUIET


MOST_POINTS = 260  # drawn in a panel; more cannot be told apart and make a page heavy
BINS = 24
FELT = 0.35  # load from which a block of |a| tells a channel's error
STEADY = 0.1 / 60.0  # °C/s below which the temperature counts as held

_DEG_PER_SECOND = DEG_PER_HOUR / 3600.0
_BRANCHES = ((1, "heating"), (-1, "cooling"))


def course(
    rows: Residuals, driver: str, channel: str
) -> tuple[Float[np.ndarray, " block"], str, bool]:
    """What a driver's residuals are drawn against, its label, and whether branches are told apart.

    `driver` is a name of the catalogue's; without the quantity in the campaign it is time.
    """
    axis = "xyz".index(channel[-1]) if channel[-1] in "xyz" else 0
    if driver in ("temperature", "temperature_branch") and rows.temperature is not None:
        return rows.temperature, "temperature, °C", True
    if driver == "temperature_rate" and rows.temperature_rate is not None:
        return 60.0 * rows.temperature_rate, "rate of temperature, °C/min", False
    if driver == "time_since_move":
        return rows.since_move, "time since the last move, s", False
    if driver == "rate" and rows.rate is not None:
        return _DEG_PER_SECOND * rows.rate[:, axis], f"rate {'xyz'[axis]}, °/s", False
    if driver == "specific_force" and rows.force is not None:
        if rows.triad == "gyro":
            axis = _strongest(rows, channel)
        return rows.force[:, axis], f"specific force {'xyz'[axis]}, g", False
    if driver in ("input", "output", "specific_force", "attitude") and np.any(rows.input):
        factor, unit = (1.0, "g") if rows.triad == "accel" else (_DEG_PER_SECOND, "°/s")
        return factor * rows.input[:, axis], f"input {'xyz'[axis]}, {unit}", False
    return (*_time(rows), False)


def _strongest(rows: Residuals, channel: str) -> int:
    """The axis of specific force that a gyro's residual follows most."""
    assert rows.force is not None
    force = rows.force - rows.force.mean(axis=0)
    y = rows.before[:, rows.of(channel)]
    size = np.linalg.norm(force, axis=0) + 1e-12
    return int(np.argmax(np.abs(force.T @ (y - y.mean())) / size))


def _time(rows: Residuals) -> tuple[np.ndarray, str]:
    time = rows.time - rows.time[0]
    # Recordings whose clock starts again stand behind each other.
    if np.any(np.diff(time) < 0):
        steps = np.diff(time, prepend=time[0])
        time = np.cumsum(np.where(steps < 0, np.median(np.abs(steps)), steps))
    if np.ptp(time) > 3 * 3600.0:
        return time / 3600.0, "time, h"
    return time / 60.0, "time, min"


def branch(rows: Residuals) -> np.ndarray:
    """+1 where the temperature was last reached from below, −1 from above, held through soaks."""
    assert rows.temperature_rate is not None
    sign = np.where(np.abs(rows.temperature_rate) > STEADY, np.sign(rows.temperature_rate), 0)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    return np.where(sign[last] == 0, 1, sign[last]).astype(int)


def before_and_after(rows: Residuals, driver: str, channels: tuple[str, ...]) -> Figure:
    """Residuals against the driver, left of the model as meant, right with the effects in it.

    One row of panels for each channel; dots are blocks of a few seconds, lines are means.
    """
    figure, axes = new_figure(len(channels), 2, height=0.55 + 2.0 * len(channels), sharex=True)
    factor, unit = scale(rows)
    for left, right in zip(axes[::2], axes[1::2]):
        right.sharey(left)
        right.tick_params(labelleft=False)
    for k, channel in enumerate(channels):
        x, label, by_branch = course(rows, driver, channel)
        for j, values in enumerate((rows.before, rows.after)):
            ax = axes[2 * k + j]
            y, weight = on_channel(rows, factor * values[:, rows.of(channel)], channel)
            _cloud(ax, rows, x, y, weight, by_branch and rows.temperature_rate is not None)
            from matplotlib.ticker import MaxNLocator

            ax.xaxis.set_major_locator(MaxNLocator(6))
            if k == 0:
                ax.set_title("model as meant" if j == 0 else "with what was found in the model")
            if k == len(channels) - 1 or label != course(rows, driver, channels[-1])[1]:
                ax.set_xlabel(label)
        axes[2 * k].set_ylabel(f"{row_name(rows, channel)}, {unit}")
    if axes[1].get_legend_handles_labels()[0]:
        axes[1].legend(loc="best", fontsize=8)
    return figure


def over_time(rows: Residuals) -> Figure:
    """Residuals of every channel against time, before and after, as means over neighbouring blocks."""
    count = len(rows.channels)
    figure, axes = new_figure(count, 1, height=0.7 + 1.45 * count, sharex=True)
    factor, unit = scale(rows)
    x, label = _time(rows)
    same = not rows.changed
    # Means must not join what a pause parts.
    breaks = np.flatnonzero(np.diff(x) > 20.0 * np.median(np.diff(x))) + 1
    pieces = np.split(np.arange(len(x)), breaks)
    for ax, channel in zip(axes, rows.channels):
        for k, (values, name) in enumerate(
            ((rows.before, "model as meant"), (rows.after, "with what was found"))
        ):
            if k and same:
                break
            y, colour = factor * values[:, rows.of(channel)], COLOURS[1 - k]
            for n, mine in enumerate(pieces):
                at, mean = grouped(x[mine], y[mine], max(8, MOST_POINTS // len(pieces)))
                text = "_" if n else name
                ax.plot(at, mean, MARKERS[k], color=colour, ms=2.4, ls="none", label=text)
        ax.axhline(0.0, color=INK, lw=0.6)
        ax.set_ylabel(f"{row_name(rows, channel)}, {unit}")
    axes[-1].set_xlabel(label)
    if not same:
        legend_above(axes[0], columns=2)
    return figure


def scale(rows: Residuals) -> tuple[float, str]:
    """Factor from SI and unit in which a triad's residuals are drawn."""
    size = float(np.sqrt(np.mean(rows.before**2)))
    if rows.triad == "accel":
        micro = 1e6 / 9.80665
        return (micro, "µg") if size * micro < 1e3 else (1e-3 * micro, "mg")
    if rows.channels == (TURN,):
        return 1e3, "mrad"
    if size * DEG_PER_HOUR < 1e3:
        return DEG_PER_HOUR, "°/h"
    return _DEG_PER_SECOND, "°/s"


def row_name(rows: Residuals, channel: str) -> str:
    """A row of panels, in words."""
    if rows.channels == (TURN,):
        return TURN
    if channel.startswith("|"):
        return "size of specific force"
    return f"{'accelerometer' if rows.triad == 'accel' else 'gyro'} {channel[-1]}"


def on_channel(
    rows: Residuals, values: np.ndarray, channel: str
) -> tuple[Float[np.ndarray, " block"], Float[np.ndarray, " block"]]:
    """Rows as the error of one channel's output that would make them, and the weight of each block.

    A row of |a| feels the output i by its load, $\\partial |a| / \\partial a'_i$; a block in which the channel
    hardly feels gravity says little.
    """
    if rows.loads is None or channel[-1] not in "xyz":
        return values, np.ones(len(values))
    load = rows.loads[:, "xyz".index(channel[-1])]
    seen = np.abs(load) > FELT
    return np.where(seen, values / np.where(seen, load, 1.0), 0.0), np.where(seen, load**2, 0.0)


def _cloud(
    ax: Axes, rows: Residuals, x: np.ndarray, y: np.ndarray, weight: np.ndarray, by_branch: bool
) -> None:
    seen = weight > 0.0
    groups = [(seen, "", 0)]
    if by_branch:
        side = branch(rows)
        groups = [(seen & (side == s), name, k) for k, (s, name) in enumerate(_BRANCHES)]
        groups = [g for g in groups if g[0].any()]
    for mine, _, k in groups:
        step = -(-int(mine.sum()) * len(groups) // MOST_POINTS)
        ax.plot(x[mine][::step], y[mine][::step], ".", color=COLOURS[k], ms=2.2, alpha=0.35)
    for mine, name, k in groups:
        order = np.argsort(x[mine], kind="stable")
        at, mean = grouped(x[mine][order], y[mine][order], BINS, weight[mine][order])
        ax.plot(
            at, mean, MARKERS[k], ls="-", color=COLOURS[k], ms=4, lw=1.1, label=name or "_",
            markeredgecolor="white", markeredgewidth=0.5,
        )  # fmt: skip
    ax.axhline(0.0, color=QUIET, lw=0.8)


def grouped(
    x: np.ndarray, y: np.ndarray, most: int, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Means over neighbours: over equal values of x where these are few, else over equal numbers."""
    levels, which = np.unique(np.round((x - x.min()) / (np.ptp(x) + 1e-12), 3), return_inverse=True)
    if len(levels) > most:
        which = np.arange(len(x)) * most // len(x)
    weight = np.ones(len(x)) if weight is None else weight
    count = np.bincount(which, weights=weight)
    kept = count > 0
    return tuple(np.bincount(which, weights=weight * v)[kept] / count[kept] for v in (x, y))  # pyright: ignore[reportReturnType]
