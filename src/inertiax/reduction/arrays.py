"""Dwell means given as arrays: shapes and units checked, absent columns filled in."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..data.plausible_units import (
    check_force,
    check_from_zero,
    check_rate,
    check_ratio,
    check_rest_force,
    check_temperature,
)
from ..physics.leaves import is_traced, real_numbers
from ..physics.shapes import check_covariance


CALL = "Dwells.from_arrays"

# 1 sigma of a mean, m/s² and rad/s, beyond which it is in another unit: no calibration comes of such means.
GREATEST_SIGMA = {"accel": 0.5, "gyro": 0.1}
TURNING = 1e-3  # rad/s of the reference: more than the Earth turns


def triad(name: str, values: Any) -> Any:
    """An array (…, dwells, 3) of finite numbers; `None` stays."""
    if values is None:
        return None
    array = numbers(name, values)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise ValueError(f"`{CALL}({name}=...)`: shape {array.shape}; it must be (…, dwells, 3).")
    return array


def numbers(name: str, values: Any) -> Any:
    """Real numbers as an array, traced ones as they are."""
    return values if is_traced(values) else real_numbers(f"{CALL}({name}=...)", values)


def column(name: str, values: Any, shape: tuple[int, ...], default: Any) -> Any:
    """An array that broadcasts to (…, dwells), or the default where it is absent."""
    given = default if values is None else numbers(name, values)
    return fitted(name, given, shape)


def fitted(name: str, values: Any, shape: tuple[int, ...]) -> Any:
    """The array broadcast to a shape. Raises `ValueError` that names the argument."""
    if is_traced(values):
        return values
    try:
        return np.broadcast_to(np.asarray(values), shape)
    except ValueError:
        raise ValueError(
            f"`{CALL}({name}=...)`: shape {np.shape(values)} does not fit the outputs' {shape}."
        ) from None


def labels(name: str, values: Any, shape: tuple[int, ...], default: Any) -> Any:
    """Whole numbers of shape (…, dwells)."""
    array = column(name, values, shape, default)
    if is_traced(array):
        return array
    if not np.array_equal(array, np.round(array)):
        raise ValueError(f"`{CALL}({name}=...)`: must hold whole numbers.")
    return array.astype(int)


def mask(values: Any, shape: tuple[int, ...]) -> Any:
    """True or false of shape (…, dwells)."""
    if values is None or is_traced(values):
        return np.ones(shape, bool) if values is None else values
    array = np.asarray(values)
    if not np.isin(array, (0, 1)).all():
        raise ValueError(f"`{CALL}(valid=...)`: must hold true and false.")
    return fitted("valid", array.astype(bool), shape)


def finite(name: str, values: Any, valid: Any) -> None:
    """Raise `ValueError` where a valid dwell has no number."""
    if values is None or is_traced(values) or is_traced(valid):
        return
    own = np.isfinite(values).reshape(*valid.shape, -1).all(axis=-1)
    bad = np.argwhere(valid & ~own)
    if len(bad):
        place = bad[0].tolist()
        apart = "; fit triads with dwells of their own apart, `calibration.changed(gyro=other.gyro)` joins them"
        raise ValueError(
            f"`{CALL}({name}=...)`: not a finite number at dwell "
            f"{tuple(place) if len(place) > 1 else place[0]}; drop it or make it invalid by `valid`"
            f"{apart * (name in ('accel', 'gyro'))}."
        )


def filled(values: Any, valid: Any) -> Any:
    """Rows that only pad, in place of whatever they hold, as the device's first valid row."""
    if values is None or is_traced(values) or is_traced(valid) or valid.all():
        return values
    first = np.argmax(valid, axis=-1)
    rows = np.where(valid, np.arange(valid.shape[-1]), first[..., None])
    extra = (1,) * (values.ndim - valid.ndim)
    return np.take_along_axis(values, rows.reshape(*rows.shape, *extra), axis=valid.ndim - 1)


def covariance(name: str, sigma: Any, outputs: Any, valid: Any) -> Any:
    """Covariances of means (…, dwells, 3, 3) from 1 sigma of them, or from covariances themselves; zero: unknown.

    One sigma a dwell is one for its three axes, where its shape is not also that of axes.
    """
    if outputs is None:
        return None
    shape = outputs.shape
    if sigma is None:
        return np.zeros((*shape, 3))
    given = numbers("sigma", sigma)
    if given.ndim == len(shape) + 1:
        if given.shape[-2:] != (3, 3):
            raise ValueError(
                f"`{CALL}(sigma=...)`: shape {given.shape}; covariances are {(*shape, 3)}."
            )
        made = fitted("sigma", given, (*shape, 3))
        if not is_traced(made):
            check_covariance(f"{CALL}(sigma=...)", made)
        return made
    if not is_traced(given):
        unit = "m/s²" if name == "accel" else "rad/s"
        check_from_zero(f"{CALL}(sigma=...)", given, GREATEST_SIGMA[name], f"{unit} for {name}")
        given = _of_outputs(given, shape)
        if not is_traced(valid) and np.any(given[valid] == 0.0):
            raise ValueError(
                f"`{CALL}(sigma=...)`: 0; it must be above 0 {unit} for {name}. Leave it out where it is not known."
            )
    return (given**2)[..., None] * np.eye(3)


def _of_outputs(given: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    for each in (given, given[..., None]):
        try:
            return np.broadcast_to(each, shape)
        except ValueError:
            continue
    raise ValueError(
        f"`{CALL}(sigma=...)`: shape {given.shape} does not fit the outputs' {shape}; it is one number, (3,) by axis, "
        f"{shape[:-1]} by dwell, {shape}, or covariances {(*shape, 3)}."
    )


def sigmas(sigma: Any, accel: Any, gyro: Any) -> tuple[Any, Any]:
    """What `sigma` says of each triad."""
    if accel is not None and gyro is not None and sigma is not None:
        if isinstance(sigma, Sequence) and len(sigma) == 2:
            return sigma[0], sigma[1]
        raise ValueError(
            f"`{CALL}(sigma=...)`: with both triads it is a pair (of accel in m/s², of gyro in rad/s)."
        )
    return sigma, sigma


# All columns -----------------------------------------------------------------------------------------


def columns(
    accel: Any, gyro: Any, reference_accel: Any, reference_gyro: Any, temperature: Any, valid: Any
) -> dict[str, Any]:
    """The measured columns of `Dwells`, checked, of one shape, with `valid`.

    Raises `ValueError` as `Dwells.from_arrays` says.
    """
    given = {
        "accel": triad("accel", accel),
        "gyro": triad("gyro", gyro),
        "reference_accel": triad("reference_accel", reference_accel),
        "reference_gyro": triad("reference_gyro", reference_gyro),
    }
    outputs = [x for x in (given["accel"], given["gyro"]) if x is not None]
    if not outputs:
        raise ValueError(f"`{CALL}(...)`: give `accel`, `gyro` or both.")
    if len({x.shape for x in outputs}) > 1:
        raise ValueError(
            f"`{CALL}(gyro=...)`: shape {outputs[1].shape} does not fit that of accel, {outputs[0].shape}."
        )
    shape = outputs[0].shape[:-1]
    if 0 in shape:
        raise ValueError(
            f"`{CALL}(...)`: shape {outputs[0].shape} has no dwells; at least one is needed."
        )
    kept = mask(valid, shape)
    made = {k: None if x is None else fitted(k, x, (*shape, 3)) for k, x in given.items()}
    made["temperature"] = column("temperature", temperature, shape, 0.0)
    for name, values in made.items():
        finite(name, values, kept)
        made[name] = filled(values, kept)
    _check_units(made, kept)
    return {**made, "valid": kept}


def _check_units(made: dict[str, Any], kept: Any) -> None:
    check_temperature(CALL, made["temperature"], kept)
    for name, check in (("accel", check_force), ("gyro", check_rate)):
        reference = made[f"reference_{name}"]
        check(CALL, f"reference_{name}", reference, kept)
        check_ratio(CALL, name, made[name], reference, kept, TURNING if name == "gyro" else 1.0)
        if name == "accel" and reference is None:
            check_rest_force(CALL, name, made[name], kept)
        check(CALL, name, made[name], kept)
