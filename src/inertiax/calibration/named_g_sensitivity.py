"""A named g-sensitivity as what it is, the gyros' matrix D: other tools' formats have a place for that."""

from dataclasses import replace

import numpy as np

from ..physics.temperature import constant_one, Curve
from .fitted_effects import FittedEffect
from .pytree import Calibration
from .triad import TriadCalibration


def with_matrix_d(calibration: Calibration) -> Calibration:
    """The calibration with each named g-sensitivity of constant coefficients added to the gyros' parameters D.

    Both add D f to the outputs, with f in g. The covariance between D and the other parameters is not known of a
    named effect, and is zero.
    """
    mine = tuple(e for e in calibration.effects if _is_matrix_d(e))
    if calibration.gyro is None or not mine:
        return calibration
    gyro, spread = calibration.gyro, None
    for effect in mine:
        gyro, spread = _with_rows(gyro, effect)
        cross = calibration.cross_covariance
        if cross is not None:
            calibration = replace(calibration, gyro=gyro, cross_covariance=cross @ spread.T)
    others = tuple(e for e in calibration.effects if e not in mine)
    return replace(calibration, gyro=gyro, effects=others)


def _is_matrix_d(effect: FittedEffect) -> bool:
    return (
        effect.name == "g_sensitivity"
        and effect.triad == "gyro"
        and set(effect.plain_settings) == {"axes"}
    )


def _with_rows(gyro: TriadCalibration, effect: FittedEffect) -> tuple[TriadCalibration, np.ndarray]:
    """The gyros with an effect's rows of D, and the matrix that puts their old coefficients into the new order."""
    basis, axes = gyro.curve.basis, str(effect.plain_settings["axes"])
    added = [
        [f"gyro.g_sensitivity[{c},{'xyz'.index(axis)}]" for axis in axes] for c in effect.channels
    ]
    names = gyro.names + tuple(n for row in added for n in row if n not in gyro.names)
    place = np.zeros((len(names), len(axes)))
    for row in added:
        place[[names.index(n) for n in row], np.arange(len(axes))] = 1.0
    one = constant_one(basis)
    spread = np.kron(np.eye(len(one)), np.eye(len(names), len(gyro.names)))
    put = np.kron(one[:, None], place)
    coefficients = spread @ np.ravel(gyro.curve.coefficients) + put @ np.asarray(
        effect.coefficients
    )
    covariance = spread @ np.asarray(gyro.covariance) @ spread.T
    covariance = covariance + put @ np.asarray(effect.covariance) @ put.T
    curve = Curve(basis, coefficients.reshape(len(one), len(names)))
    return replace(gyro, curve=curve, covariance=covariance, names=names), spread
