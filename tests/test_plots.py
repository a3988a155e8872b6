"""Figures: what they show is what was given, and nothing is cut off or overlaps."""

import os
import re

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from demo_data import ACCEL_NAMES, demo_result, made_dwells
from inertiax.calibrate.observability import Observability
from inertiax.calibrate.pipeline import TriadResult
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.stacking import stack
from inertiax.data.recording import Recording
from inertiax.diagnose import Diagnosis
from inertiax.diagnose.result import Moved, Quality, Where
from inertiax.estimators import Invariant
from inertiax.physics.temperature import Constant, Curve, Polynomial
from inertiax.plots import (
    calibration as plots,
    calibration_panels as panels,
    demo as demo_plots,
    diagnosis as diagnosis_plots,
    figure_workers,
)
from inertiax.plots.figure_workers import Drawing, drawn_aside
from inertiax.plots.noise_panels import allan, AllanCurve, AllanPanel
from inertiax.plots.style import drawing, families, Figure, new_figure, to_png, to_svg
from inertiax.procedure.thermal_iterations import ThermalSolution
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.segments import Segments


GYRO_NAMES = (
    *(f"gyro.bias[{i}]" for i in range(3)),
    *(f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)),
    *(f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)),
)


def triad(names: tuple[str, ...], basis, *, sigma: float = 1e-4, scale: float = 1e-3):
    """A triad whose coefficients are k-th row, i-th column: scale · (1 + i) / (1 + k)."""
    size, count = basis.size, len(names)
    coefficients = scale * (1.0 + np.arange(count)) / (1.0 + np.arange(size)[:, None])
    covariance = sigma**2 * np.eye(size * count)
    return TriadCalibration(
        Curve(basis, jnp.asarray(coefficients)), jnp.asarray(covariance), names, "invariant"
    )


def texts_of(figure: Figure):
    """All texts that are drawn, with their boxes in pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # lays out
    drawn = []
    with pytest.MonkeyPatch.context() as patch:
        # Many texts exist without being drawn, such as ticks outside the limits.
        original = Text.draw
        patch.setattr(Text, "draw", lambda t, renderer: (drawn.append(t), original(t, renderer)))
        canvas.draw()
    named = [t for t in drawn if t.get_visible() and t.get_text().strip()]
    return [(t.get_text(), t.get_window_extent()) for t in dict.fromkeys(named)]


def assert_readable(figure: Figure):
    """No text is cut by the figure's edge and no two texts overlap."""
    with drawing():
        found = texts_of(figure)
    assert len(found) > 3
    edge = figure.bbox
    for name, box in found:
        assert box.x0 >= edge.x0 - 1 and box.x1 <= edge.x1 + 1, f"{name!r} is cut at a side"
        assert box.y0 >= edge.y0 - 1 and box.y1 <= edge.y1 + 1, f"{name!r} is cut above or below"
    for k, (name, box) in enumerate(found):
        for other, second in found[:k]:
            across = min(box.x1, second.x1) - max(box.x0, second.x0)
            along = min(box.y1, second.y1) - max(box.y0, second.y0)
            # Boxes have a line's full height; two pixels of common margin hide nothing.
            assert across <= 2 or along <= 2, f"{name!r} overlaps {other!r}"


def test_the_check_for_readability_can_fail():
    with drawing():
        figure, (ax,) = new_figure(1, 1, height=2.0)
        ax.set(xlabel="time, s", ylabel="output", title="title")
        ax.text(0.5, 0.5, "first", transform=ax.transAxes)
        ax.text(0.52, 0.5, "second", transform=ax.transAxes)
    with pytest.raises(AssertionError, match="overlaps"):
        assert_readable(figure)


@pytest.mark.slow
@pytest.mark.parametrize("names", [ACCEL_NAMES, GYRO_NAMES])
def test_curves_are_the_polynomials_with_95_percent_bands(names):
    one = triad(names, Polynomial(2, -40.0, 60.0))
    with drawing():
        figure = plots.parameter_curves(one, (-40.0, 60.0))
    ax = figure.axes[0]
    line = ax.get_lines()[1]  # bias y
    t, shown = line.get_data()
    x = (2.0 * np.asarray(t) - 20.0) / 100.0
    # Chebyshev by hand: T0 = 1, T1 = x, T2 = 2x² − 1; parameter 1 has coefficients 2e-3 (1, ½, ⅓).
    value = 2e-3 * (1.0 + x / 2.0 + (2.0 * x**2 - 1.0) / 3.0)
    factor = 1.0 if names is ACCEL_NAMES else 180.0 / np.pi * 3600.0
    np.testing.assert_allclose(shown, factor * value, rtol=1e-12)
    band = ax.collections[1].get_paths()[0].vertices
    at = np.argmin(np.abs(t - 60.0))
    top = max(y for x_, y in band if x_ == t[at])
    x = (2.0 * t[at] - 20.0) / 100.0
    sigma = 1e-4 * np.sqrt(1.0 + x**2 + (2.0 * x**2 - 1.0) ** 2)
    np.testing.assert_allclose(top, factor * (value[at] + 1.959964 * sigma), rtol=1e-9)
    assert_readable(figure)


@pytest.mark.slow
@pytest.mark.parametrize("names", [ACCEL_NAMES, GYRO_NAMES, GYRO_NAMES[:3]])
def test_constants_are_shown_with_their_intervals(names):
    with drawing():
        figure = plots.constant_parameters(triad(names, Constant()))
    assert_readable(figure)
    (bar, *_) = figure.axes[0].containers
    low, high = bar.lines[2][0].get_segments()[0][:, 1]
    factor = 1.0 if names is ACCEL_NAMES else 180.0 / np.pi * 3600.0
    np.testing.assert_allclose((high - low) / 2.0, factor * 1.959964e-4, rtol=1e-6)


def test_a_calibration_draws_both_triads():
    hot = Polynomial(2, -40.0, 60.0)
    calibration = Calibration(
        9.81,
        triad(ACCEL_NAMES, hot),
        triad(GYRO_NAMES[:3], Constant()),
        temperature_range=(-30.0, 50.0),
    )
    figure = calibration.plot()
    assert figure.get_suptitle() == "bands and bars hold 95 %"
    assert [ax.get_title(loc="left") for ax in figure.axes if ax.get_visible()] == [
        "accel: bias", "accel: scale factor", "accel: misalignment", "gyro: bias",
    ]  # fmt: skip
    # 5 % of the 80 °C beyond the calibrated range on both sides.
    assert figure.axes[0].get_xlim() == pytest.approx((-34.0, 54.0))
    values, _ = calibration.accel.over(np.array([-34.0]))
    first = [line.get_ydata()[0] for line in figure.axes[0].get_lines()]
    np.testing.assert_allclose(first, values[0, :3], rtol=1e-12)
    assert_readable(figure)


def test_what_has_no_single_device_is_not_drawn():
    one = Calibration(9.81, triad(ACCEL_NAMES, Constant()))
    with pytest.raises(ValueError, match="2.* devices are stacked"):
        stack([one, one]).plot()
    with pytest.raises(ValueError, match="no triad is calibrated"):
        Calibration(9.81).plot()


def test_coverage_is_an_equal_area_projection():
    tilt = np.deg2rad(60.0)
    up = [np.sin(tilt), 0.0, np.cos(tilt)]
    with drawing():
        figure = panels.coverage(9.8 * np.array([up, [0.0, 0.0, -1.0], [0.0, -1.0, -1e-9]]))
    points = [ax.get_lines()[-1].get_data() for ax in figure.axes]
    # Lambert's azimuthal projection to a unit disc of the hemisphere: r = √(1 − cos θ) = √½ at 60°.
    np.testing.assert_allclose(points[0], [[0.5**0.5], [0.0]], atol=1e-12)
    np.testing.assert_allclose(points[1], [[0.0, 0.0], [0.0, -1.0]], atol=1e-8)
    assert_readable(figure)


def test_coverage_of_one_attitude_has_two_whole_discs():
    with drawing():
        figure = panels.coverage(np.tile([[0.5, 0.2, 9.8]], (100, 1)))
        figure.draw_without_rendering()
    assert all(ax.get_position().width > 0.4 for ax in figure.axes)
    assert_readable(figure)


def _recording(num: int) -> Recording:
    rng = np.random.default_rng(0)
    return Recording(time=0.01 * np.arange(num), accel=rng.normal(size=(num, 3)), name="a log")


def test_a_spike_of_one_sample_in_a_long_log_is_drawn():
    recording = _recording(200_000)
    assert recording.accel is not None
    recording.accel[123_456, 1] = 77.0
    found = Segments(np.array([0]), np.array([1000]), np.array([0]), np.ones(1000, bool))
    with drawing():
        figure = plots.rests([recording], [found])
    heights = [c.get_paths()[0].vertices[:, 1].max() for c in figure.axes[0].collections]
    assert max(heights) == 77.0
    assert_readable(figure)


def _result(misfit: np.ndarray, sigma: np.ndarray, dwells: Dwells) -> TriadResult:
    one = triad(ACCEL_NAMES, Constant())
    solution = ThermalSolution(
        curve=one.curve,
        covariance=one.covariance,
        residuals=misfit / sigma,
        result=optx.RESULTS.successful,
        num_iterations=jnp.asarray(3),
        history=np.zeros((2, 1, 9)),
        step_sizes=np.zeros(2),
        method="joint",
    )
    return TriadResult(
        estimator=Invariant(gravity=9.81),
        solution=solution,
        dwells=dwells,
        misfit=misfit,
        sigma=sigma,
        observability=Observability(2.0, 9, 9, ()),
        scatter=0.0,
        chi2_per_dof=1.0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, 3])
def test_misfits_are_drawn_against_order_temperature_and_position(rows):
    rng = np.random.default_rng(1)
    dwells = made_dwells(rng)
    misfit = rng.normal(size=(dwells.num_dwells, rows))
    sigma = np.full_like(misfit, 0.5)
    sigma[3] = 1e6  # a dwell that is all but unknown must not flatten the others
    with drawing():
        figure = plots.misfits(_result(misfit, sigma, dwells))
    assert [ax.get_xlabel() for ax in figure.axes] == [
        "dwell, in order of time",
        "temperature, °C",
        "position",
    ]
    assert figure.axes[0].get_ylim()[1] < 10.0
    assert_readable(figure)


@pytest.mark.slow
@pytest.mark.parametrize(
    "draw",
    [
        demo_plots.temperatures,
        demo_plots.curves,
        lambda r: demo_plots.differences(r, 1),
        lambda r: demo_plots.signed_differences(r, 2),
        demo_plots.check,
    ],
)
def test_the_papers_figures_are_readable(draw):
    with drawing():
        assert_readable(draw(demo_result()))


def test_the_diagnosis_figures_are_readable():
    places = tuple(
        Where(channel, n, 1000.0 * n + 100.0, 1000.0 * n + 700.0, driver, 1e-4, 1e-9)
        for n, driver in enumerate(("temperature_rate", "specific_force", "time"))
        for channel in ("accel_x", "gyro_z")
    )
    names = [*ACCEL_NAMES, *GYRO_NAMES]
    found = Diagnosis(
        verdict="missing-physics",
        summary="",
        where=places,
        baseline=Quality(3e-4, 9.8, 4e-4),
        augmented=Quality(1e-4, 1.02, 2e-5),
        parameters_moved=tuple(Moved(n, 0.0, float(k), 1.0) for k, n in enumerate(names)),
    )
    recordings = [
        Recording(time=1000.0 * n + np.arange(800.0), accel=np.ones((800, 3))) for n in range(3)
    ]
    with drawing():
        for figure in (
            diagnosis_plots.places(found, recordings),
            diagnosis_plots.pulled(found),
            diagnosis_plots.improvement(found),
        ):
            assert_readable(figure)
        bars = diagnosis_plots.places(found, recordings).axes[0].containers
        # Experiment 1 departs from 1100 to 1700 s: from 18.3 to 28.3 min.
        np.testing.assert_allclose(bars[2].patches[0].get_bbox().intervalx, [1100 / 60, 1700 / 60])
        shown = [t.get_text() for t in diagnosis_plots.pulled(found).axes[0].get_yticklabels()]
    assert shown[-1] == names[-1] and len(shown) == 20  # largest on top, no more than 20


def test_svg_needs_nothing_from_elsewhere_and_takes_the_pages_ink():
    with drawing():
        svg = to_svg(panels.coverage(np.eye(3)))
    assert svg.startswith("<svg") and svg.endswith("</svg>")
    assert "currentColor" in svg and "<metadata" not in svg
    # Names of XML namespaces are the only addresses.
    assert not re.findall(r'(?:href|src)="(?!#)', svg)
    assert not re.findall(r"url\((?!#)", svg)
    with drawing():
        assert svg == to_svg(panels.coverage(np.eye(3)))


def test_a_common_power_of_ten_stands_beside_the_axis_in_plain_text():
    with drawing():
        figure, (small, large, plain) = new_figure(1, 3, height=2.0)
        for ax, reach in ((small, 3e-5), (large, 4e7), (plain, 12.0)):
            ax.set_ylim(-reach, reach)
        FigureCanvasAgg(figure).draw()
    offsets = [ax.yaxis.get_offset_text().get_text() for ax in (small, large, plain)]
    assert offsets == ["×10⁻⁵", "×10⁷", ""]
    shown = [t.get_text() for t in small.get_yticklabels()]
    assert "2" in shown and "−2" in shown


@pytest.mark.slow
def test_figures_drawn_by_other_processes_are_the_same():
    wanted = Drawing(to_png, panels.coverage, np.eye(3))
    here = wanted.begin()()
    with drawn_aside("inertiax.plots.calibration_panels", several=True):
        assert [finish() for finish in [wanted.begin() for _ in range(3)]] == 3 * [here]
        wrong = Drawing(to_png, panels.coverage, np.eye(2)).begin()
        with pytest.raises(IndexError):  # as here
            wrong()
        workers = figure_workers._workers
        assert workers is not None and len(workers._pipes) == 1 + hasattr(os, "fork")
        workers._process.kill()
        workers._process.wait()
        assert [finish() for finish in [wanted.begin() for _ in range(3)]] == 3 * [here]
    assert figure_workers._workers is None


@pytest.mark.parametrize(
    "low, high", [(1.3e-4, 3.2e-3), (1.3e-4, 8e-4), (2.2e-4, 4.3e-4), (2.1e-4, 2.3e-4)]
)
def test_an_allan_plot_within_a_decade_has_two_numbers_to_read_it_by(low, high):
    tau = np.geomspace(0.01, 100.0, 20)
    curve = np.geomspace(high, low, 20)
    one = AllanCurve("gyro_x", tau, curve, curve, curve, tau, curve)
    with drawing():
        figure = allan([AllanPanel("Allan deviation, rad/s", (one,))])
        FigureCanvasAgg(figure).draw()
    (ax,) = figure.axes
    bottom, top = ax.get_ylim()
    shown = [t for t in ax.get_yticks() if bottom <= t <= top]
    labels = [ax.yaxis.get_major_formatter()(t, None) for t in shown]
    assert len(set(filter(None, labels))) >= 2
    assert len(shown) <= 10  # and no crowd of them


def test_installed_fonts_stand_behind_the_figures_own(monkeypatch):
    """Each for what those before it lack; a family that is not there is not asked for, which would warn."""
    import matplotlib as mpl

    families.cache_clear()
    monkeypatch.setattr("inertiax.plots.style._FURTHER", ("No Such Font", "STIXGeneral"))
    with drawing():
        assert mpl.rcParams["font.family"] == ["DejaVu Sans", "STIXGeneral"]
    families.cache_clear()
