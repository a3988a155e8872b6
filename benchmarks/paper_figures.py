"""The figures of `paper_tables.py`, each from the arrays that it gathers over seeds."""

import convergence_study
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inertiax.plots.style import COLOURS, INK, legend_above, MARKERS, new_figure, QUIET
from inertiax.simulate.plan import PAPER_GRAVITY


GRID = np.linspace(-54.0, 59.0, 114)  # °C, where all sets have data
BIAS, SCALE = [0, 1, 2], [3, 5, 8]
CHANGES = {1: 15.0, 2: 4.0, 3: 0.5}
ARCSEC = np.rad2deg(1.0) * 3600.0
REPORTED = {"bias": 2e-4, "scale": 25e-6, "check": 16.0}  # by the founding paper: m/s², 1, arcsec
QUANTITIES = ((BIAS, 1e3, "bias, 10⁻³ m/s²"), (SCALE, 1e6, "scale-factor error, ppm"))
METHODS = (("traditional", "traditional"), ("paper", "paper, 2 passes"), ("default", "default"))

Found = dict[str, np.ndarray]


def shade(ax: Axes, x: np.ndarray, values: np.ndarray, colour: str, label: str) -> None:
    """Median over seeds with its 5–95 % band."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95], axis=0)
    ax.fill_between(x, low, high, color=colour, alpha=0.22, lw=0)
    ax.plot(x, middle, color=colour, label=label)


def curves(found: Found) -> Figure:
    """One seed's curves with the truth; below, what is left of every seed and axis."""
    figure, axes = new_figure(2, 2, height=5.0, sharex=True)
    fitted, truth = found["default, set 3"][0], found["truth"][0]
    for ax, (columns, factor, name) in zip(axes[:2], QUANTITIES):
        for k, column in enumerate(columns):
            ax.plot(GRID, factor * fitted[:, column], color=COLOURS[k], label="xyz"[k])
            ax.plot(GRID[::10], factor * truth[::10, column], MARKERS[k], color=COLOURS[k], ms=3)
        ax.set(ylabel=name)
        legend_above(ax)
    errors = ((BIAS, 1e5, "error of the bias, 10⁻⁵ m/s²"), (SCALE, 1e6, "of the scale factor, ppm"))
    for ax, (columns, factor, name) in zip(axes[2:], errors):
        for k, number in enumerate((1, 2, 3)):
            off = found[f"default, set {number}"] - found["truth"]
            off = np.swapaxes(off[..., columns], 1, 2).reshape(-1, len(GRID))
            shade(ax, GRID, factor * off, COLOURS[k + 3], f"set {number} ({CHANGES[number]:g} °C)")
        ax.set(xlabel="temperature, °C", ylabel=name)
    figure.legend(*axes[2].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def differences(found: Found, number: int) -> Figure:
    """|set `number` − set 3|, greatest of three axes, by three approaches."""
    figure, axes = new_figure(1, 2, height=3.2)
    for ax, columns, factor, bound, title in (
        (axes[0], BIAS, 1.0, REPORTED["bias"], "bias, m/s²"),
        (axes[1], SCALE, 1e6, 1e6 * REPORTED["scale"], "scale factor, ppm"),
    ):
        for k, (method, label) in enumerate(METHODS):
            change = found[f"{method}, set {number}"] - found[f"{method}, set 3"]
            shade(ax, GRID, factor * np.abs(change[..., columns]).max(axis=2), COLOURS[k], label)
        ax.axhline(bound, color=INK, ls=":", lw=1, label="founding paper: at most")
        ax.set_yscale("log")
        ax.set(title=f"|set {number} − set 3|: {title}", xlabel="temperature, °C")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def check(found: Found) -> Figure:
    """|a| − g on the check: single samples above, means of each position below."""
    figure, axes = new_figure(2, 3, height=4.6, sharex=True)
    minutes, position = found["time"][0] / 60.0, found["position"][0]
    stops = [np.flatnonzero(position == p) for p in np.unique(position)]
    stops.sort(key=lambda rows: rows[0])
    middle = np.array([minutes[rows].mean() for rows in stops])
    for n, (above, below) in enumerate(zip(axes[:3], axes[3:]), start=1):
        values = found[f"check: default, set {n}"] / PAPER_GRAVITY * ARCSEC
        for rows in stops:
            low, high = np.quantile(values[:, rows], [0.05, 0.95])
            label = "default, samples of 1 s" if rows is stops[0] else None
            above.fill_between(
                minutes[rows], low, high, color=COLOURS[2], alpha=0.35, lw=0, label=label
            )
        for sign in (-1.0, 1.0):
            label = "founding paper: at most" if sign > 0 else None
            above.axhline(sign * REPORTED["check"], color=INK, ls=":", lw=1, label=label)
        above.set(title=f"set {n} ({CHANGES[n]:g} °C)", ylim=(-18.0, 18.0))
        for k, (method, label) in enumerate(METHODS[1:], start=1):
            own = found[f"check: {method}, set {n}"] / PAPER_GRAVITY * ARCSEC
            means = np.stack([own[:, rows].mean(axis=1) for rows in stops], axis=1)
            low, centre, high = np.quantile(means, [0.05, 0.5, 0.95], axis=0)
            below.errorbar(
                middle + 0.12 * (k - 1.5), centre, yerr=[centre - low, high - centre],
                fmt=MARKERS[k], color=COLOURS[k], ms=3.5, lw=1.2, label=f"{label}, position's mean",
            )  # fmt: skip
        for ax in (above, below):
            ax.axhline(0.0, color=QUIET, lw=0.8)
        below.set(xlabel="time, min", ylim=(-1.4, 1.4))
    for ax in (axes[0], axes[3]):
        ax.set_ylabel("(|a| − g) / g, ″")
    handles = [h + k for h, k in zip(*(axes[i].get_legend_handles_labels() for i in (0, 3)))]
    figure.legend(*handles, loc="outside lower center", ncols=2)
    return figure


def rates(grid: list[dict]) -> Figure:
    """Predicted against observed rates, and the radius over the temperature change."""
    figure, axes = new_figure(1, 2, height=3.3)
    predicted, observed = (np.array([r[k] for r in grid]) for k in ("predicted", "observed"))
    for sign in (-10.0, 10.0):
        label = "accepted: 10 %" if sign > 0 else None
        axes[0].axhline(sign, color=INK, lw=1, ls=":", label=label)
    off = 100.0 * (predicted / observed - 1.0)
    axes[0].semilogx(observed, off, "o", color=COLOURS[0], ms=2.5, label="plans")
    axes[0].set(
        xlabel="observed factor per pass", ylabel="predicted radius off by, %", ylim=(-12, 12)
    )
    legend_above(axes[0])
    for k, drift in enumerate(convergence_study.GRID_DRIFTS):
        own = [
            r for r in grid if (r["degree"], r["drift"], r["order"]) == (6, drift, "given")
        ]  # fmt: skip
        axes[1].loglog(
            [r["change"] for r in own],
            [r["predicted"] for r in own],
            MARKERS[k] + "-",
            color=COLOURS[k],
            label=drift,
        )
    axes[1].axhline(1.0, color=INK, lw=0.8, ls=":")
    axes[1].annotate("diverges above", (0.5, 1.0), xytext=(0, 3), textcoords="offset points", fontsize=8)  # fmt: skip
    changes = convergence_study.CHANGES
    axes[1].set(
        xlabel="temperature change in an experiment, °C", ylabel="spectral radius, degree 6"
    )
    axes[1].set_xticks(changes, [f"{c:g}" for c in changes])
    axes[1].minorticks_off()
    legend_above(axes[1], columns=2)
    return figure


def plans(found: list[dict]) -> Figure:
    """Errors of random plans over the joint fit's, against the radius of the paper's iteration."""
    figure, (ax,) = new_figure(1, 1, height=3.2)
    radius = [p["radius"] for p in found]
    for key, marker, colour, label in (
        ("paper_ratio", "s", COLOURS[1], "paper, 2 passes"),
        ("ratio", "o", COLOURS[2], "default"),
    ):
        ax.loglog(radius, [p[key] for p in found], marker, color=colour, ms=3, label=label)
    ax.axvline(1.0, color=INK, lw=0.8, ls=":")
    ax.axhline(1.1, color=INK, lw=0.8, ls="--", label="1.1 × the joint fit")
    ax.set(
        xlabel="spectral radius of the paper's iteration (diverges right of the dotted line)",
        ylabel="error over that of the joint fit",
    )
    legend_above(ax)
    return figure
