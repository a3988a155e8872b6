"""The formats that a calibration can be written in; a new one is a file here and a name in the list."""

import inspect
import json
from collections.abc import Mapping
from types import ModuleType
from typing import Any, get_args

import msgspec
import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.device_place import about_device
from ..calibration.named_g_sensitivity import with_matrix_d
from ..data.formats.columns import nearest
from ..storage.wrong_value import WrongValue
from . import (
    ardupilot,
    aria,
    azure,
    basalt,
    c_header,
    imu_tk,
    imucal,
    kalibr,
    native,
    px4,
    realsense,
    stablehlo,
)
from .export import Export


FORMATS: tuple[ModuleType, ...] = (
    kalibr,
    imu_tk,
    imucal,
    px4,
    ardupilot,
    azure,
    aria,
    basalt,
    realsense,
    c_header,
    stablehlo,
    native,
)


def by_name(name: str) -> ModuleType:
    """The format of that name. Raises `ValueError` with the nearest one."""
    names = [f.NAME for f in FORMATS]
    if name not in names:
        raise ValueError(
            f"format '{name}' is not known; {nearest(name, names)}one of {', '.join(names)} is needed."
        )
    return FORMATS[names.index(name)]


def settings_of(module: ModuleType, given: Mapping[str, str | float | int]) -> Any:
    """The `Settings` of a format, numbers perhaps given as text. Raises `WrongValue` for an unknown or wrong one."""
    name, fields = module.NAME, {f.name: f for f in msgspec.structs.fields(module.Settings)}
    for key in given:
        if key not in fields:
            known = f"known are {', '.join(fields)}" if fields else "it has none"
            raise WrongValue(f"{name}: no setting '{key}'; {nearest(key, fields)}{known}.")
    try:
        return msgspec.convert(dict(given), module.Settings, strict=False)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$.")
        key = place.rstrip("`")
        choices = get_args(fields[key].type)
        if said.startswith("Invalid enum") and choices:
            said = f"it is one of {', '.join(map(str, choices))}"
        raise WrongValue(f"{name}: {key} = {given[key]!r}: {said}.") from None


def export(calibration: Calibration, name: str, /, **settings: str | float | int) -> Export:
    """The calibration in a format, by its name; `settings` are the fields of its `Settings`.

    Numbers may be given as text. Raises `ValueError` for an unknown format or setting, for a missing
    or wrong value, and where the format cannot hold the calibration at all.
    """
    module = by_name(name)
    chosen = settings_of(module, settings)
    if module is not native:
        calibration = about_device(with_matrix_d(calibration))
    missing = [s for s in _without(module) if getattr(calibration, _FURTHER[s]) is not None]
    if missing and calibration.accel is None and calibration.gyro is None:
        holders = ", ".join(f.NAME for f in FORMATS if missing[0] not in _without(f))
        raise ValueError(
            f"{name}: has no place for {missing[0]}, and nothing else is calibrated; {holders} have one."
        )
    result = module.write(calibration, chosen)
    losses = [*result.losses, *(f"the {sensor}, for which it has no place" for sensor in missing)]
    if module is not native and calibration.effects:
        losses.append(_effects_loss(calibration))
    return result._replace(losses=tuple(losses))


_FURTHER = {"magnetometers": "mag", "barometer": "baro"}  # beside accelerometers and gyros


def _without(module: ModuleType) -> list[str]:
    """Sensors that a format has no place for."""
    return [sensor for sensor in _FURTHER if not getattr(module, sensor.upper(), False)]


def loses(module: ModuleType) -> str:
    """What a format loses of a calibration that has everything, in words."""
    return ", ".join((*_without(module), module.LOSES))


def _effects_loss(calibration: Calibration) -> str:
    """Named effects, which no foreign format holds, and how large lever arms are."""
    named = [f"{e.name} on {', '.join(e.channel_names)}" for e in calibration.effects]
    text = f"effects beside the parameters, which the stated error leaves out: {'; '.join(named)}"
    # Over unit rates the greatest component i of ω × (ω × R) is (|R| + |R_i|) / 2.
    sizes = [
        0.5 * (np.linalg.norm(e.coefficients) + abs(float(e.coefficients[k])))
        for e in calibration.effects
        for k in e.channels
        if e.name == "size_effect"
    ]
    return text + (f" (lever arms: up to {max(sizes):.2g} m/s² at 1 rad/s)" if sizes else "")


def read_calibration_of(content: bytes, name: str, /, **settings: str | float | int) -> Calibration:
    """The calibration in another tool's file; `settings` are the keywords of the format's `read`.

    Numbers may be given as text. Raises `ValueError` where the format cannot be read, or for an
    unknown or wrong setting.
    """
    module = by_name(name)
    if not hasattr(module, "read"):
        readable = [f.NAME for f in FORMATS if hasattr(f, "read")]
        raise WrongValue(f"{name}: files cannot be read back; these can: {', '.join(readable)}.")
    known = {
        k: p.annotation
        for k, p in inspect.signature(module.read).parameters.items()
        if p.kind is p.KEYWORD_ONLY
    }
    for key, value in settings.items():
        if key not in known:
            told = f"known are {', '.join(known)}" if known else "it has none"
            raise WrongValue(f"{name}: reading has no setting '{key}'; {told}.")
        try:
            settings[key] = msgspec.convert(value, known[key], strict=False)
        except msgspec.ValidationError as error:
            raise WrongValue(f"{name}: {key} = {value!r}: {error}.") from None
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused by every format
            return module.read(content, **settings)
    except json.JSONDecodeError as error:
        raise ValueError(f"{name}: not valid JSON: {error}.") from None
    except _NOT_SUCH_A_FILE as error:
        reason = " ".join(f"{type(error).__name__} {error}".split())[:200]
        raise ValueError(f"{name}: not such a file: {reason}.") from None
    except ValueError as error:  # names in it are from the file
        raise ValueError(" ".join(str(error).split())[:600]) from None


# What indexing and converting run into where a document is of another shape, or its matrix has no inverse.
_NOT_SUCH_A_FILE = (
    UnicodeDecodeError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
    np.linalg.LinAlgError,
)  # fmt: skip
