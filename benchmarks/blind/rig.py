"""Errors of the table, the pier, the place and the reference: the same cause for all channels."""

import numpy as np
from truth import Effect


def pier_tilt(s, rng):
    period, phase = 86400.0, float(rng.uniform(0, 2 * np.pi))
    wave = np.sin(2 * np.pi * s.plan.time / period + phase)
    axis = float(rng.uniform(0, 2 * np.pi))
    east = np.cross(s.plan.north, s.plan.up)
    tilt = np.cos(axis) * east + np.sin(axis) * s.plan.north
    column = np.cross(tilt, s.plan.up) * s.gravity
    return Effect(
        "pier_tilt", s.triad, [0, 1, 2], lambda a: a * wave[:, None] * column, "rad", 2e-5
    )  # fmt: skip


def table_axis_error(s, rng):
    """Inner axis not square to the outer one: case to room is Rx(a) Ry(ε) Rz(b)."""
    b = s.plan.angles[:, 1]
    about = np.stack([np.sin(b), np.cos(b), 0 * b], 1)
    column = -np.cross(about, s.plan.up) * s.gravity
    return Effect("table_axis_error", s.triad, [0, 1, 2], lambda a: a * column, "rad", 1e-3)


def earth_rate(s, rng):
    del rng
    return Effect(
        "earth_rate", s.triad, [0, 1, 2], lambda a: a * s.earth, "share of Earth rate", 1.0, fixed=1.0
    )  # fmt: skip


def gravity_error(s, rng):
    size = float(rng.uniform(1e-4, 2e-3))
    signal = lambda a: a * s.force * s.gravity
    return Effect("gravity_error", s.triad, [0, 1, 2], signal, "relative", 1.0, fixed=size)


def rate_scale_error(s, rng):
    size = float(rng.uniform(1e-4, 3e-3))
    return Effect(
        "rate_scale_error", s.triad, [0, 1, 2], lambda a: a * s.ideal, "relative", 1.0, fixed=size
    )


def table_misalignment(s, rng):
    turn = 1e-3 * rng.standard_normal(3)
    signal = lambda a: -a * np.cross(turn, s.ideal)
    return Effect("table_misalignment", s.triad, [0, 1, 2], signal, "relative", 1.0, fixed=1.0)
