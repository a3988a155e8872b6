"""The figure of a named effect: partial residuals about the fitted curve, over what drives it."""

import numpy as np
import pytest

from inertiax.diagnose.residuals import FittedCourse, Residuals
from inertiax.plots.partial_residuals import partial_residuals


G = 9.80665
K2, NOISE = 150e-6 * G, 10e-6 * G  # m/s²/g², m/s²
rng = np.random.default_rng(3)
TIME = np.arange(240.0)
FORCE = np.stack([np.cos(TIME), np.sin(TIME), np.zeros(240)], axis=1)
HEAT = np.where(TIME < 120.0, TIME, 239.0 - TIME)  # up and down again


def rows(course, noise):
    values = np.zeros((240, 3))
    values[:, 0] = course
    fitted = FittedCourse("second_order", ("accel_x",), values, 0.1 * np.abs(values))
    return Residuals(
        triad="accel", channels=("accel_x", "accel_y", "accel_z"), time=10.0 * TIME,
        experiment=np.zeros(240, int), moving=np.zeros(240, bool), since_move=np.zeros(240), input=FORCE,
        temperature=HEAT, temperature_rate=np.where(TIME < 120.0, 0.1, -0.1), force=FORCE, rate=None,
        before=values + noise, after=noise, fitted=(fitted,),
    )  # fmt: skip


def test_second_order_is_a_parabola_over_the_force_with_the_residuals_about_it():
    noise = NOISE * rng.standard_normal((240, 3))
    figure = partial_residuals(
        rows(K2 * FORCE[:, 0] ** 2, noise), "second_order", "specific_force", ("accel_x",)
    )
    effect, left = figure.axes
    assert effect.get_xlabel() == "specific force x, g"
    dots, (line,) = effect.lines[0], [x for x in effect.lines if x.get_label() == "fitted"]
    # By hand, µg: 150 f² less its mean of 75.
    x, y = dots.get_data()
    assert np.std(y - (150.0 * x**2 - 75.0)) == pytest.approx(10.0, rel=0.15)
    x, y = line.get_data()
    np.testing.assert_allclose(y, 150.0 * x**2 - 75.0, atol=1.0)
    assert np.std(left.lines[0].get_ydata()) == pytest.approx(10.0, rel=0.15)


def test_of_an_effect_of_all_axes_of_the_force_the_part_of_one_is_a_straight_line():
    noise = NOISE * rng.standard_normal((240, 3))
    course = 0.5 * K2 * FORCE[:, 0] + 0.2 * K2 * FORCE[:, 1]
    figure = partial_residuals(rows(course, noise), "second_order", "specific_force", ("accel_x",))
    effect = figure.axes[0]
    assert effect.get_xlabel() == "specific force x, g"
    x, y = next(x for x in effect.lines if x.get_label() == "fitted").get_data()
    np.testing.assert_allclose(y, 75.0 * x, atol=0.5)  # 75 µg/g; FORCE has a mean of some 0.005
    x, y = effect.lines[0].get_data()
    assert np.std(y - 75.0 * x) == pytest.approx(10.0, rel=0.15)


def test_an_effect_of_the_branch_has_a_curve_for_each_and_another_its_own_axis():
    noise = NOISE * rng.standard_normal((240, 3))
    loop = rows(np.where(TIME < 120.0, K2, -K2), noise)
    figure = partial_residuals(loop, "second_order", "temperature_branch", ("accel_x",))
    assert {"means, heating", "means, cooling"} <= {x.get_label() for x in figure.axes[0].lines}
    figure = partial_residuals(
        rows(K2 * rng.standard_normal(240), noise), "second_order", "temperature", ("accel_x",)
    )
    assert figure.axes[0].get_xlabel() == "fitted effect, µg"
    assert partial_residuals(loop, "drift", "time", ("accel_x",)) is None
