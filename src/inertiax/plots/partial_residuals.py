"""A named effect as it is in the data: what it takes from the residuals, over what drives it, with the fitted curve."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..diagnose.residuals import Residuals
from .residuals import BINS, branch, course, grouped, MOST_POINTS, on_channel, row_name, scale
from .style import Axes, COLOURS, Figure, INK, MARKERS, new_figure, QUIET


FUNCTION = 0.9  # part of an effect's scatter that a variable must tell to be drawn over it
LINEAR = 1e-6  # part of an effect's square that is left of one in proportion to the force: rounding
SIGMAS = 2.0  # of the band


class _Panel(NamedTuple):
    """One channel: what it is drawn over, the effect with its band, and both residuals."""

    x: Float[np.ndarray, " block"]
    label: str
    effect: Float[np.ndarray, " block"]
    sigma: Float[np.ndarray, " block"]
    left: Float[np.ndarray, " block"]
    groups: tuple[tuple[Bool[np.ndarray, " block"], str], ...]


def partial_residuals(
    rows: Residuals, name: str, driver: str, channels: tuple[str, ...]
) -> Figure | None:
    """Partial residuals of an effect, left, and what remains, right; `None` where the rows have no course of it.

    A partial residual is the residual beside all named effects plus what this one adds, $r + X\\hat\\beta$: about the
    curve $X\\hat\\beta$ it scatters as the residuals do. It is drawn over the effect's driver where that tells the
    effect (by each branch of the temperature where these are told apart), else over the fitted effect itself. Of an
    effect in proportion to the specific force the part along the axis that is drawn is shown.

    **Reference:** Larsen and McCleary (1972), Technometrics 14: 781.
    """
    mine = [c for c in channels if any(f.name == name and c in f.channels for f in rows.fitted)]
    if not mine:
        return None
    figure, axes = new_figure(len(mine), 2, height=0.75 + 2.1 * len(mine))
    factor, unit = scale(rows)
    for k, channel in enumerate(mine):
        panel = _panel(rows, name, driver, channel, factor)
        effect, rest = axes[2 * k], axes[2 * k + 1]
        rest.sharex(effect)
        rest.sharey(effect)
        _draw(effect, panel, panel.left + panel.effect, curve=True)
        _draw(rest, panel, panel.left, curve=False)
        rest.axhline(0.0, color=INK, lw=0.8)
        rest.tick_params(labelleft=False)
        for ax in (effect, rest):
            ax.set_xlabel(panel.label.format(unit=unit))
        effect.set_ylabel(f"{row_name(rows, channel)}, {unit}")
        if k == 0:
            effect.set_title("the effect, its curve and 2 sigma")
            rest.set_title("what is left")
            effect.legend(loc="best", fontsize=8)
    return figure


def _panel(rows: Residuals, name: str, driver: str, channel: str, factor: float) -> _Panel:
    fitted = [f for f in rows.fitted if f.name == name and channel in f.channels]
    of, place = factor, rows.of(channel)
    total = sum(f.values[:, place] for f in fitted)
    square = sum(np.square(f.sigma[:, place]) for f in fitted)
    effect, weight = on_channel(rows, of * np.asarray(total), channel)
    sigma, _ = on_channel(rows, of * np.sqrt(np.asarray(square)), channel)
    left, _ = on_channel(rows, of * rows.after[:, place], channel)
    seen = weight > 0.0
    x, label, by_branch = course(rows, driver, channel)
    groups = ((seen, ""),)
    if by_branch and rows.temperature_rate is not None:
        side = branch(rows)
        both = ((seen & (side == 1), "heating"), (seen & (side == -1), "cooling"))
        groups = tuple(g for g in both if g[0].any())
    middle = float(effect[seen].mean()) if seen.any() else 0.0
    effect = effect - middle
    square = np.square(sigma)
    along = _along(rows.force, x, effect)
    if along is not None:  # the other axes' parts would be steps in a curve over this one
        effect, square = along, np.polyval(np.polyfit(x, square, 2), x)
    if _told(x, effect, groups) < FUNCTION:
        x, label, groups = effect, "fitted effect, {unit}", ((seen, ""),)
    return _Panel(x, label, effect, np.sqrt(np.maximum(square, 0.0)), left, groups)


def _along(
    force: Float[np.ndarray, "block 3"] | None,
    x: Float[np.ndarray, " block"],
    effect: Float[np.ndarray, " block"],
) -> Float[np.ndarray, " block"] | None:
    """What an effect in proportion to the specific force is by the axis of it that x is; `None` for others."""
    axes = [] if force is None else [k for k in range(3) if np.array_equal(force[:, k], x)]
    if not axes or force is None:
        return None
    design = np.column_stack([np.ones(len(force)), force])
    parts, *_ = np.linalg.lstsq(design, effect, rcond=None)
    left = float(np.square(effect - design @ parts).sum())
    if left > LINEAR * float(np.square(effect).sum()):
        return None
    return parts[1 + axes[0]] * (x - x.mean())


def _told(
    x: Float[np.ndarray, " block"],
    effect: Float[np.ndarray, " block"],
    groups: tuple[tuple[Bool[np.ndarray, " block"], str], ...],
) -> float:
    """The part of the effect's scatter that lies between equal numbers of neighbours in x, in its groups."""
    inside, total = 0.0, 0.0
    for mine, _ in groups:
        order = np.argsort(x[mine], kind="stable")
        y = effect[mine][order]
        # Equal values of x stay together.
        place = np.searchsorted(x[mine][order], x[mine][order]) * BINS // max(len(y), 1)
        count = np.maximum(np.bincount(place, minlength=BINS), 1)
        mean = np.bincount(place, y, minlength=BINS) / count
        slope = np.zeros(len(y))  # within a bin the effect may follow x
        for b in np.unique(place):
            own = place == b
            z = x[mine][order][own] - x[mine][order][own].mean()
            if z @ z > 0.0:
                slope[own] = z * (z @ y[own]) / (z @ z)
        inside += float(np.square(y - mean[place] - slope).sum())
        total += float(np.square(effect[mine]).sum())
    return 1.0 - inside / total if total > 0.0 else 0.0


def _draw(ax: Axes, panel: _Panel, y: Float[np.ndarray, " block"], *, curve: bool) -> None:
    for k, (mine, said) in enumerate(panel.groups):
        colour, x = COLOURS[k], panel.x[mine]
        step = -(-int(mine.sum()) * len(panel.groups) // MOST_POINTS)
        ax.plot(x[::step], y[mine][::step], ".", color=colour, ms=2.6, alpha=0.45)
        order = np.argsort(x, kind="stable")
        at, mean = grouped(x[order], y[mine][order], BINS)
        name = f"means, {said}" if said else "means"
        ax.plot(at, mean, MARKERS[k], color=colour, ms=4, ls="none", label=name,
                markeredgecolor="white", markeredgewidth=0.5)  # fmt: skip
        if not curve:
            continue
        at, line = grouped(x[order], panel.effect[mine][order], MOST_POINTS // 4)
        _, band = grouped(x[order], panel.sigma[mine][order], MOST_POINTS // 4)
        ax.fill_between(
            at, line - SIGMAS * band, line + SIGMAS * band, color=QUIET, alpha=0.35, lw=0
        )
        ax.plot(
            at,
            line,
            color=INK if len(panel.groups) == 1 else colour,
            lw=1.5,
            label="fitted" if k == 0 else "_",
        )
    from matplotlib.ticker import MaxNLocator

    ax.xaxis.set_major_locator(MaxNLocator(6))
