"""Plausibility of a navigation state and of a run's data, where the numbers are known."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._typing import AnyArray
from ..data.plausible_units import check_run, farthest_outside
from ..physics.leaves import is_traced


LOWEST, HIGHEST = -12e3, 1e6  # m: the deepest trench, and space
FARTHEST_FIX = 1e6  # m from the origin of a level frame; the Earth's centre is six times as far
FASTEST = 12e3  # m/s, about what leaves the Earth
FARTHEST = 1e8  # m: a position that is less known is not on Earth
LONGEST_STEP = 1.0  # s: no filter is run more slowly, and 500 Hz in ms is 2
ROTATION = 1e-3  # departure from orthonormality that is a mistake, not rounding or a filter's drift


def check_place(call: str, place: AnyArray) -> None:
    """Raise `ValueError` where latitude or longitude is in degrees or the height is none on Earth."""
    if is_traced(place):
        return
    values = np.asarray(place)
    if values.shape[-1:] != (3,):
        raise ValueError(
            f"`{call}`: shape {values.shape}; it is latitude, longitude (rad) and height (m)."
        )
    latitude, longitude, height = (values[..., k] for k in range(3))
    worst = np.max(np.abs(latitude))
    if not worst <= 0.5 * np.pi + 1e-6:
        raise ValueError(f"`{call}`: latitude is {worst:g}; it is in rad, within ±π/2 (degrees?).")
    worst = np.max(np.abs(longitude))
    if not worst <= 2.0 * np.pi + 1e-6:
        raise ValueError(f"`{call}`: longitude is {worst:g}; it is in rad, within ±2π (degrees?).")
    if not (np.all(height >= LOWEST) and np.all(height <= HIGHEST)):
        raise ValueError(
            f"`{call}`: height is {farthest_outside(height, LOWEST, HIGHEST):g}; it is in m above the ellipsoid."
        )


def check_rotation(call: str, matrix: AnyArray) -> None:
    """Raise `ValueError` where a matrix is no rotation."""
    if is_traced(matrix):
        return
    values = np.asarray(matrix, float)
    if values.shape[-2:] != (3, 3):
        raise ValueError(
            f"`{call}`: shape {values.shape}; it is a rotation matrix (3, 3), case to level."
        )
    off = np.abs(values @ np.swapaxes(values, -1, -2) - np.eye(3)).max()
    if not off < ROTATION:
        raise ValueError(
            f"`{call}`: it is not a rotation matrix (C Cᵀ differs from E by {off:.2g})."
        )
    least = float(np.min(np.linalg.det(values)))
    if not least > 0.0:
        raise ValueError(
            f"`{call}`: it is not a rotation matrix (its determinant is {least:.3g}: a mirror; is an axis of the "
            f"wrong sign, or the frame left-handed?)."
        )


def check_speed(call: str, velocity: AnyArray) -> None:
    """Raise `ValueError` where a velocity is none in m/s."""
    if is_traced(velocity):
        return
    worst = float(np.max(np.abs(np.asarray(velocity))))
    if not worst <= FASTEST:
        raise ValueError(
            f"`{call}`: {worst:g} m/s is faster than anything that stays near the Earth (mm/s?)."
        )


def check_near(call: str, positions: AnyArray) -> None:
    """Raise `ValueError` where positions are none in a level frame."""
    if is_traced(positions):
        return
    far = float(np.max(np.abs(np.asarray(positions, float)), initial=0.0))
    if far > FARTHEST_FIX:
        raise ValueError(
            f"`{call}`: {far:.4g} m; positions are metres east, north and up of `LevelFrame`'s origin (Earth-centred?)."
        )


def check_one_run(call: str, times: AnyArray, cure: str) -> None:
    """Raise `ValueError` where a track holds the times of several runs."""
    if jnp.ndim(times) > 1:
        raise ValueError(
            f"`{call}`: the track holds {jnp.shape(times)[:-1]} runs, but this is for one; use {cure}."
        )


def check_data(call: str, data: Any) -> None:
    """Raise `ValueError` where an `ImuData` holds more than one run."""
    rows = jnp.shape(data.temperature)
    if len(rows) != 1:
        raise ValueError(f"`{call}`: temperature has shape {rows}; it is (time,).")


def check_samples(call: str, data: Any) -> None:
    """Raise `ValueError` where shapes of an `ImuData` do not fit each other, or its numbers are implausible; runs may
    lead."""
    rows = jnp.shape(data.temperature)
    if rows == () and jnp.ndim(data.accel) > 1:
        raise ValueError(
            f"`{call}(temperature=...)`: one number; it is one a sample, such as `np.full({jnp.shape(data.accel)[0]}, "
            f"20.0)`, or NaN where there is no probe."
        )
    for name in ("accel", "gyro"):
        shape = jnp.shape(getattr(data, name))
        if shape != (*rows, 3):
            raise ValueError(
                f"`{call}({name}=...)`: shape {shape}; beside temperatures of shape {rows} it must be {(*rows, 3)}."
            )
    step = data.step
    if isinstance(step, float | int | np.ndarray | np.generic | jax.Array) and not is_traced(step):
        if not 0.0 < float(np.max(step)) <= LONGEST_STEP:
            raise ValueError(
                f"`{call}(step=...)`: {float(np.max(step)):g}; it is in s, above 0 and up to {LONGEST_STEP:g} (the "
                f"sample rate, or ms?)."
            )
    for name in ("accel", "gyro"):
        _check_numbers(call, name, getattr(data, name))
    check_run(call, data.accel, data.gyro, data.temperature)


def _check_numbers(call: str, name: str, values: Any) -> None:
    """Raise `ValueError` for samples that are no numbers, which nothing after them would survive."""
    if is_traced(values):
        return
    bad = np.argwhere(~np.isfinite(np.asarray(values)).all(axis=-1))
    if len(bad):
        at = bad[0].tolist()
        raise ValueError(
            f"`{call}({name}=...)`: not a finite number at sample {at[0] if len(at) == 1 else tuple(at)} ({len(bad)} "
            f"such samples); a run has no gaps, so interpolate them or cut the run there."
        )
