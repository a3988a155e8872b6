"""A known calibration before a diagnosis: taken away first, and joined with what the diagnosis found.

If a first calibration was applied and a second one estimated on what it left, the pair is one calibration,
equation (6): $M = M_0 M_1$, $b = b_0 + M_0 b_1$, and an effect e of the second stage is $M_0 e$ on the raw outputs.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..._jax import Array, eqx, jax, jnp
from ...calibration.calibration import Calibration, TriadCalibration
from ...calibration.fitted_effects import FittedEffect
from ...data.recording import Campaign
from ...effects import CATALOGUE, Effect
from ...physics.composition import compose_imu
from ...physics.error_model import AccelerometerErrors, GyroErrors
from ...physics.temperature import (
    AbstractBasis,
    Constant,
    CubicSpline,
    Curve,
    interpolate,
    Polynomial,
)
from .applied_effects import compensate


_ELEMENTS = tuple((i, j) for i in range(3) for j in range(3))


def taken_away(
    campaign: Campaign, calibration: Calibration, effects: Sequence[Effect] = CATALOGUE
) -> Campaign:
    """The campaign with its outputs compensated, named effects of the calibration included.

    Raises `ValueError` where the calibration depends on temperature and a recording has none.
    """
    triads = [t for t in (calibration.accel, calibration.gyro) if t is not None]
    by_temperature = any(not isinstance(t.curve.basis, Constant) for t in triads)
    made = []
    for recording in campaign.recordings:
        if by_temperature and recording.temperature is None:
            raise ValueError(
                f"recording '{recording.name}': no temperature column, but the known calibration depends on "
                f"temperature; record it, or diagnose without --calibration."
            )
        outputs = compensate(calibration, recording, effects=effects)
        made.append(
            eqx.tree_at(
                lambda r: (r.accel, r.gyro), recording, (outputs.accel, outputs.gyro),
                is_leaf=lambda x: x is None,
            )
        )  # fmt: skip
    return eqx.tree_at(lambda c: c.recordings, campaign, tuple(made))


def succeeding(first: Calibration, second: Calibration) -> Calibration:
    """One calibration for raw outputs, of a first one and of a second estimated on what it left.

    Parameters that are polynomials in temperature give polynomials of the sum of the degrees, exactly;
    splines are matched at their knots.
    """
    covered = [r for r in (second.temperature_range, first.temperature_range) if r is not None]
    effects = tuple(_on_raw(e, first) for e in second.effects)
    return Calibration(
        second.gravity,
        _joined("accel", first, second),
        _joined("gyro", first, second),
        device=second.device or first.device,
        temperature_range=covered[0] if covered else None,
        notes=(*first.notes, *second.notes),
        effects=(*first.effects, *effects),
    )


def _joined(triad: str, first: Calibration, second: Calibration) -> TriadCalibration | None:
    one: TriadCalibration | None = getattr(first, triad)
    two: TriadCalibration | None = getattr(second, triad)
    if one is None or two is None:
        return one if two is None else two
    names = _names(triad, any("g_sensitivity" in n for n in (*one.names, *two.names)))
    basis = _basis(one.curve.basis, two.curve.basis)

    def coefficients(
        a: Float[Array, "size0 parameters0"], b: Float[Array, "size1 parameters1"]
    ) -> Float[Array, " unknowns"]:
        stages = []
        for stage, own, c in ((first, one, a), (second, two, b)):
            changed = eqx.tree_at(lambda t: t.curve.coefficients, own, c)
            stages.append(
                eqx.tree_at(
                    lambda s: getattr(s, triad), stage, changed, is_leaf=lambda x: x is None
                )
            )
        values = [
            _parameters(triad, stages[0], stages[1], float(t))[: len(names)] for t in basis.nodes
        ]
        return interpolate(basis, jnp.stack(values)).ravel()

    a, b = jnp.asarray(one.curve.coefficients), jnp.asarray(two.curve.coefficients)
    slopes = jax.jacfwd(coefficients, argnums=(0, 1))(a, b)
    covariance = sum(
        np.asarray(s).reshape(len(s), -1)
        @ np.asarray(t.covariance)
        @ np.asarray(s).reshape(len(s), -1).T
        for s, t in zip(slopes, (one, two))
    )
    curve = Curve(basis, coefficients(a, b).reshape(basis.size, len(names)))
    return TriadCalibration(curve, jnp.asarray(covariance), names, two.estimator)


def _names(triad: str, by_force: bool) -> tuple[str, ...]:
    kinds = ["matrix"] + (["g_sensitivity"] if by_force else [])
    names = [f"{triad}.bias[{i}]" for i in range(3)]
    return tuple(names + [f"{triad}.{k}[{i},{j}]" for k in kinds for i, j in _ELEMENTS])


def _basis(one: AbstractBasis, two: AbstractBasis) -> AbstractBasis:
    for basis in (one, two):
        if isinstance(basis, CubicSpline):
            return basis
    polynomials = [b for b in (one, two) if isinstance(b, Polynomial)]
    if not polynomials:
        return Constant()
    return Polynomial(
        sum(p.degree for p in polynomials),
        min(p.low for p in polynomials),
        max(p.high for p in polynomials),
    )


def _parameters(
    triad: str, first: Calibration, second: Calibration, temperature: float
) -> Float[Array, " parameters"]:
    """Bias, matrix and, for gyros, g-sensitivity of the pair at one temperature."""
    stages = [(c.accel_errors(temperature), c.gyro_errors(temperature)) for c in (first, second)]
    pair: tuple[AccelerometerErrors, GyroErrors] = compose_imu(stages[0], stages[1], first.gravity)
    if triad == "accel":
        return jnp.concatenate([pair[0].bias, pair[0].matrix.ravel()])
    return jnp.concatenate([pair[1].bias, pair[1].matrix.ravel(), pair[1].g_sensitivity.ravel()])


def _on_raw(effect: FittedEffect, first: Calibration) -> FittedEffect:
    """The effect in the unit of the raw outputs, by the first stage's scale factors."""
    covered = first.temperature_range or (20.0, 20.0)
    at = 0.5 * sum(covered)
    errors = first.accel_errors(at) if effect.triad == "accel" else first.gyro_errors(at)
    scale = 1.0 + float(np.mean(np.diag(np.asarray(errors.matrix))[list(effect.channels)]))
    return eqx.tree_at(
        lambda e: (e.coefficients, e.covariance),
        effect,
        (scale * np.asarray(effect.coefficients), scale**2 * np.asarray(effect.covariance)),
    )
