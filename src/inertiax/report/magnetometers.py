"""The magnetometers in the report of `inertiax calibrate`, on the terminal and as a document."""

import math
from pathlib import Path

import numpy as np

from ..calibrate.results import DeviceResult, MagnetometerResult
from ..calibration.magnetometers import MagnetometerCalibration
from ..calibration.quantities import middle_temperature, rms_text, si_unit
from ..physics.temperature import Constant
from ..plots import calibration as curves
from ..plots.magnetometers import field_before_and_after
from ..plots.style import drawing
from .page import Key, Picture, picture, Section, Table
from .values import Value


TITLE = "Magnetometers"
FIGURES = ("curves-mag", "field-mag")


def magnetometer_keys(result: DeviceResult) -> list[Key]:
    """What is left of the field, and what it rests on."""
    mag = result.mag
    if mag is None:
        return []
    rows = f"{mag.num_rests} rests, {mag.dwells.num_dwells - mag.num_rests} samples in motion"
    return [Key(f"{TITLE}: rms misfit", rms_text("T", mag.rms), rows)]


def magnetometer_sections(
    result: DeviceResult, parameters: Table | None, folder: Path
) -> list[Section]:
    """Parameters, their curves, and the field before and after."""
    mag, calibration = result.mag, result.calibration.mag
    if mag is None or calibration is None or parameters is None:
        return []
    caption = (
        f"{TITLE}: magnitude of the field as recorded and compensated (line: the field at the place); what is left of "
        "it, with 1 sigma; and at the rests what is left of its upward part."
    )
    with drawing():
        before_and_after = picture(
            field_before_and_after(mag), folder, "field-mag", caption, caption
        )
    figures = (_curves(result, calibration, folder), before_and_after)
    return [Section(TITLE, lines=mag.statements, tables=(parameters,), figures=figures)]


def _curves(result: DeviceResult, mag: MagnetometerCalibration, folder: Path) -> Picture:
    ends = result.calibration.temperature_range
    constant = isinstance(mag.triad.curve.basis, Constant) or ends is None
    with drawing():
        if constant or ends is None:
            figure = curves.constant_parameters(mag.triad)
            caption = "Constant parameters with their 95 % intervals."
        else:
            figure = curves.parameter_curves(mag.triad, ends)
            caption = "Parameters over temperature with their 95 % bands."
        return picture(figure, folder, "curves-mag", caption, f"{TITLE}: {caption}")


def magnetometer_document(result: DeviceResult) -> dict[str, Value]:
    """The entry `mag` of a device, as those of the other triads; empty without any."""
    mag, calibration = result.mag, result.calibration.mag
    if mag is None or calibration is None:
        return {}
    (values,), (sigmas,) = calibration.triad.over(
        np.array([middle_temperature(result.calibration)])
    )
    return {"mag": {**_of_field(mag, calibration), "parameters": [
        {"name": name, "value": float(value), "std": float(sigma), "unit": si_unit(name)}
        for name, value, sigma in zip(calibration.triad.names, values, sigmas, strict=True)
    ]}}  # fmt: skip


def _of_field(mag: MagnetometerResult, calibration: MagnetometerCalibration) -> dict[str, Value]:
    finite = lambda x: float(x) if math.isfinite(float(x)) else None
    return {
        "estimator": "field",
        "frame": mag.frame,
        "field": float(calibration.field),
        "field_given": mag.field_given,
        "dip": finite(calibration.dip),
        "dip_std": finite(calibration.dip_sigma),
        "terms_over_temperature": calibration.triad.curve.basis.size,
        "num_rests": mag.num_rests,
        "num_in_motion": mag.dwells.num_dwells - mag.num_rests,
        "rms": mag.rms,
        "scatter": mag.scatter,
        "unit": "T",
        "chi2_per_dof": finite(mag.chi2_per_dof),
    }
