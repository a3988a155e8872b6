"""Effects that are in no catalogue: the right answer is `unexplained`."""

import numpy as np
from truth import gradient, one


def x_bump(s, rng):
    span = np.ptp(s.heat.case)
    centre = float(s.heat.case.min() + span * rng.uniform(0.25, 0.75))
    width = float(span * rng.uniform(0.04, 0.09))
    column = np.exp(-0.5 * ((s.heat.case - centre) / width) ** 2)
    made = one(s, rng, "x_bump", lambda c: column, "bias", "SI")
    made.detail = {"centre": centre, "width": width}
    return made


def x_ripple(s, rng):
    turns = float(rng.uniform(4, 7))
    x = (s.heat.case - s.heat.case.min()) / np.ptp(s.heat.case)
    column = np.sin(2 * np.pi * turns * x + rng.uniform(0, 2 * np.pi))
    made = one(s, rng, "x_ripple", lambda c: column, "bias", "SI")
    made.detail = {"periods": turns}
    return made


def x_cubic_times_temperature(s, rng):
    column = lambda c: s.sensor.scaled(s.heat.case) * s.force[:, c] ** 3
    return one(s, rng, "x_cubic_times_temperature", column, "second", "SI")


def x_rate_times_temperature(s, rng):
    form = gradient(s) * s.sensor.scaled(s.heat.case)
    made = one(s, rng, "x_rate_times_temperature", lambda c: form, "bias", "SI per K/s")
    made.limit *= 120
    return made


def x_kink_in_rate(s, rng):
    top = np.abs(s.ideal).max()
    level = float(rng.uniform(0.25, 0.6))
    column = lambda c: np.tanh((s.ideal[:, c] / top - level) / 0.03) * top
    made = one(s, rng, "x_kink_in_rate", column, "rate", "relative")
    made.detail = {"level": level * top}
    return made


def x_burst(s, rng):
    centre = float(s.plan.time[int(len(s.plan.time) * rng.uniform(0.25, 0.75))])
    width = float(s.plan.time[-1] * rng.uniform(0.03, 0.07))
    column = np.exp(-0.5 * ((s.plan.time - centre) / width) ** 2)
    made = one(s, rng, "x_burst", lambda c: column, "bias", "SI")
    made.span = [[centre - 2 * width, centre + 2 * width]]
    return made


def x_notch_in_force(s, rng):
    level = float(rng.uniform(0.3, 0.7))
    column = lambda c: np.exp(-0.5 * ((s.force[:, c] - level) / 0.12) ** 2)
    made = one(s, rng, "x_notch_in_force", column, "bias", "SI")
    made.detail = {"level": level}
    return made
