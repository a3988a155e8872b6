"""Figures in the manner of the founding paper's figures 2 to 6."""

import numpy as np

from ..analysis.paper_experiment import DemoResult, METHODS
from .style import (
    AXIS_NAMES,
    COLOURS,
    DASHES,
    Figure,
    INK,
    legend_above,
    MARKERS,
    new_figure,
    QUIET,
)


_BIAS = (0, 1, 2)
_SCALE = (3, 5, 8)
_DEFAULT = 2  # of METHODS


def temperatures(result: DemoResult) -> Figure:
    """Figure 2: the temperature within each experiment, for the three sets."""
    figure, axes = new_figure(1, 3, height=2.9, sharey=True)
    for number, (ax, one) in enumerate(zip(axes, result.sets, strict=True), start=1):
        experiment = np.asarray(one.dwells.experiment)
        start = one.plan.start_times()
        for n in np.unique(experiment):
            rows = experiment == n
            minutes = (np.asarray(one.dwells.time)[rows] - start[n]) / 60.0
            ax.plot(minutes, np.asarray(one.dwells.temperature)[rows], color=COLOURS[0], lw=1.1)
        ax.set(title=f"set {number}: {one.change:g} °C", xlabel="time in the experiment, min")
    axes[0].set_ylabel("temperature, °C")
    return figure


def curves(result: DemoResult, number: int = 3) -> Figure:
    """Figure 3: bias and scale-factor error over temperature, with each experiment's own estimate."""
    one = result.sets[number - 1]
    fitted = result.curves(number, _DEFAULT)
    figure, axes = new_figure(1, 2, height=3.1)
    for ax, columns, factor, name in (
        (axes[0], _BIAS, 1e3, "bias, 10⁻³ m/s²"),
        (axes[1], _SCALE, 1e6, "scale-factor error, ppm"),
    ):
        for k, column in enumerate(columns):
            ax.plot(result.grid, factor * fitted[:, column], color=COLOURS[k], label=AXIS_NAMES[k])
            ax.plot(
                one.point_temperature,
                factor * one.points[:, column],
                MARKERS[k],
                color=COLOURS[k],
                ms=4,
            )
        ax.set(xlabel="temperature, °C", ylabel=name)
        legend_above(ax)
    return figure


def differences(result: DemoResult, number: int) -> Figure:
    """Figures 4 and 5: curves of set 1 or 2 less those of set 3, by three ways of calibration.

    Each way is drawn as the range over the three axes, so that ways can be compared.
    """
    figure, axes = new_figure(1, 2, height=3.4)
    for ax, columns, factor, name in (
        (axes[0], _BIAS, 1.0, "bias, m/s²"),
        (axes[1], _SCALE, 1e6, "scale-factor error, ppm"),
    ):
        smallest = np.inf
        for k in range(len(METHODS) - 1):
            change = result.curves(number, k) - result.curves(3, k)
            size = factor * np.max(np.abs(change[:, columns]), axis=1)
            smallest = min(smallest, float(np.quantile(size, 0.05)))
            ax.semilogy(result.grid, size, DASHES[k], color=COLOURS[k], label=METHODS[k])
        noise = _noise_of_difference(result, number)[:, columns].max(axis=1)
        ax.semilogy(result.grid, factor * noise, ":", color=INK, lw=1, label="1 sigma of the noise")
        ax.set_ylim(bottom=0.3 * smallest)
        ax.set(xlabel="temperature, °C", ylabel=f"|set {number} − set 3|: {name}")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, handlelength=2.5
    )
    return figure


def signed_differences(result: DemoResult, number: int) -> Figure:
    """Figures 4 and 5 as the paper draws them: the default's differences, axis by axis, with the
    95 % band that noise alone gives."""
    change = result.curves(number, _DEFAULT) - result.curves(3, _DEFAULT)
    noise = 1.96 * _noise_of_difference(result, number)
    figure, axes = new_figure(1, 2, height=3.1)
    for ax, columns, factor, name in (
        (axes[0], _BIAS, 1e6, "bias, 10⁻⁶ m/s²"),
        (axes[1], _SCALE, 1e6, "scale-factor error, ppm"),
    ):
        ax.axhline(0.0, color=INK, lw=0.8)
        half = factor * noise[:, columns].max(axis=1)
        ax.fill_between(result.grid, -half, half, color=QUIET, alpha=0.22, lw=0)
        for k, column in enumerate(columns):
            ax.plot(result.grid, factor * change[:, column], color=COLOURS[k], label=AXIS_NAMES[k])
        ax.set(xlabel="temperature, °C", ylabel=f"set {number} − set 3: {name}")
        legend_above(ax)
    return figure


def _noise_of_difference(result: DemoResult, number: int) -> np.ndarray:
    one, third = result.sets[number - 1].deviations, result.sets[2].deviations
    return np.sqrt(one**2 + third**2)


def check(result: DemoResult) -> Figure:
    """Figure 6: |a| − g on the check, by the models of the three sets; traditional and default."""
    figure, axes = new_figure(2, 1, height=4.6, sharex=True)
    minutes = result.check_time / 60.0
    for ax, method in zip(axes, (0, _DEFAULT), strict=True):
        ax.axhline(0.0, color=INK, lw=0.8)
        for k, one in enumerate(result.sets):
            ax.plot(
                minutes,
                1e3 * one.check_misfit[method],
                MARKERS[k],
                color=COLOURS[k],
                ms=2.6,
                mew=0,
                alpha=0.75,
                label=f"set {k + 1} ({one.change:g} °C)",
            )
        ax.set(title=METHODS[method], ylabel="|a| − g, 10⁻³ m/s²")
    legend_above(axes[0])
    axes[1].set_xlabel("time, min (the chamber warms by 2 °C/min from +20 °C)")
    return figure
