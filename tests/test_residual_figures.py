"""Figures of residuals: true to their data, with units, branches told apart, nothing overlapping."""

from dataclasses import replace

import numpy as np
import pytest

from inertiax.diagnose.residuals import Residuals
from inertiax.plots.residuals import (
    before_and_after,
    branch,
    course,
    grouped,
    on_channel,
    over_time,
)
from inertiax.plots.style import drawing


G = 9.80665


def rows(triad="gyro", single=False, scale=1e-6):
    """A ramp up, a soak and a ramp down, with a gap between the branches before."""
    n = 300
    temperature = np.interp(np.arange(n), [0, 100, 200, 300], [0.0, 50.0, 50.0, 0.0])
    slope = np.gradient(temperature) / 10.0
    gap = np.where(np.arange(n) < 150, 1.0, -1.0)[:, None]
    force = np.stack([np.sin(np.arange(n)), np.cos(np.arange(n)), np.zeros(n)], axis=1)
    channels = (f"|{triad}|",) if single else tuple(f"{triad}_{a}" for a in "xyz")
    return Residuals(
        triad=triad, channels=channels, time=10.0 * np.arange(n), experiment=np.zeros(n, int),
        moving=np.zeros(n, bool), since_move=np.arange(n) % 30.0, input=force, temperature=temperature,
        temperature_rate=slope, force=force, rate=0.1 * force,
        before=scale * gap * np.ones((1, len(channels))), after=np.zeros((n, len(channels))),
        loads=force if single else None,
    )  # fmt: skip


def test_branches_are_drawn_apart_and_in_the_customary_unit():
    with drawing():
        figure = before_and_after(rows(), "temperature_branch", ("gyro_x",))
        figure.draw_without_rendering()
    left, right = figure.axes
    means = {line.get_label(): line for line in left.lines if not line.get_label().startswith("_")}
    # 1e-6 rad/s is 0.20626 °/h by hand; heating up to the soak's middle is positive.
    assert set(means) == {"heating", "cooling"}
    assert np.asarray(means["heating"].get_ydata())[0] == pytest.approx(0.206265, rel=1e-4)
    assert np.asarray(means["cooling"].get_ydata())[0] == pytest.approx(-0.206265, rel=1e-4)
    assert "°/h" in left.get_ylabel() and "°C" in left.get_xlabel()
    assert left.get_ylim() == right.get_ylim()


def test_a_branch_is_held_through_a_soak():
    side = branch(rows())
    assert set(side[:200]) == {1} and set(side[210:]) == {-1}


@pytest.mark.parametrize(
    ("driver", "word", "unit"),
    [
        ("temperature", "temperature", "°C"),
        ("temperature_rate", "rate of temperature", "°C/min"),
        ("rate", "rate", "°/s"),
        ("specific_force", "specific force", "g"),
        ("time_since_move", "since the last move", "s"),
        ("time", "time", "min"),
        ("supply", "time", "min"),
    ],
)
def test_each_driver_has_its_axis_with_a_unit(driver, word, unit):
    values, label, _ = course(rows(), driver, "gyro_y")
    assert word in label and label.endswith(unit) and values.shape == (300,)


def test_labels_do_not_overlap_and_nothing_is_cut():
    with drawing():
        for figure in (
            before_and_after(rows("accel", True, 1e-3), "specific_force", ("accel_x", "accel_y")),
            over_time(rows()),
        ):
            figure.draw_without_rendering()
            box = figure.bbox
            for ax in figure.axes:
                labels = [t.get_window_extent() for t in ax.get_xticklabels() if t.get_text()]
                inside = [
                    b for b in labels if ax.bbox.x0 - 1 <= 0.5 * (b.x0 + b.x1) <= ax.bbox.x1 + 1
                ]
                assert all(a.x1 <= b.x0 for a, b in zip(inside, inside[1:]))
                name = ax.yaxis.label.get_window_extent()
                assert name.x0 >= box.x0 and name.y0 >= box.y0 - 1 and name.y1 <= box.y1 + 1


def test_a_row_of_the_size_is_the_error_of_the_channel_that_makes_it():
    single = rows("accel", True)
    # d|a|/da'_y = load: an error e of y gives the row load·e.
    error = 2e-3
    assert single.loads is not None
    values, weight = on_channel(single, error * single.loads[:, 1], "accel_y")
    seen = weight > 0
    np.testing.assert_allclose(values[seen], error, rtol=1e-12)
    assert seen.sum() < 300 and np.all(np.abs(single.loads[seen, 1]) > 0.3)


def test_means_are_taken_over_levels_or_over_equal_numbers():
    x, y = np.repeat([0.0, 1.0, 2.0], 10), np.repeat([5.0, 6.0, 7.0], 10)
    np.testing.assert_allclose(grouped(x, y, 24), [[0, 1, 2], [5, 6, 7]], atol=1e-12)
    at, mean = grouped(np.arange(1000.0), np.arange(1000.0), 10)
    np.testing.assert_allclose(mean, at)
    assert len(at) == 10


@pytest.mark.parametrize("scale", [1e-2, 1e-9])
def test_rows_are_changed_by_what_is_taken_from_them_whatever_their_size(scale):
    """1e-9 rad/s is 2e-4 °/h, a navigation gyro's."""
    found = rows(scale=scale)
    assert found.changed
    same = replace(found, after=found.before * (1.0 + 1e-15))
    assert not same.changed
