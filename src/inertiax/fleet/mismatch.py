"""Score statistics of the catalogue over many devices: what a line's residuals have in common.

For a device with whitened misfit r, parameter Jacobian J and the signature s of a catalogued effect (what a
unit of it would add to the misfit), what the calibration cannot absorb of the signature is
s̃ = s − J (JᵀJ)⁻¹ Jᵀ s, and

    amplitude = s̃ᵀ r / s̃ᵀ s̃,    sigma = 1 / ‖s̃‖

is the estimate of the effect's size by one linear step. It costs no further solve, so that it is taken for every device
and effect in one pass; `line` reads the answers over the whole fleet.

**Reference:** Rao's score test (1948); the projection is that of Frisch, Waugh and Lovell.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..dwells import Dwells
from ..effects import CATALOGUE, Effect, Signal, Variant
from ..estimators import AbstractEstimator
from ..temperature import AbstractBasis
from .batch import FleetFit


# Effects that dwell means show; the others need the samples, see `inertiax diagnose`.
SEEN_IN_MEANS = (
    "temperature_order", "temperature_rate", "thermal_hysteresis", "temperature_dependence", "drift",
    "second_order", "third_order", "odd_quadratic", "scale_asymmetry", "cross_coupling",
    "g_sensitivity", "g2_sensitivity", "rate_nonlinearity", "cross_axis_rate",
    "table_misalignment", "table_axis_error", "gravity_error", "rate_scale_error",
)  # fmt: skip
FORMS = 3  # of one effect, at most: spread over its grid
ABSORBED = 0.02  # part of a signature that must be left beside the calibration


class Term(eqx.Module):
    """One effect in one form on one channel."""

    name: str = eqx.field(static=True)
    channel: str = eqx.field(static=True)  # "accel_x", or "all" for an effect of the rig
    form: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    of_rig: bool = eqx.field(static=True)


class FleetScores(eqx.Module):
    """Amplitudes of every term in every device. NaN where the plan does not show a term."""

    terms: tuple[Term, ...] = eqx.field(static=True)
    amplitude: Float[np.ndarray, "devices terms"]
    sigma: Float[np.ndarray, "devices terms"]
    overlap: Float[np.ndarray, "terms terms"]  # mean correlation of what is left of two signatures


class _Shape(eqx.Module):
    """One column of an effect's shape."""

    effect: Effect = eqx.field(static=True)
    variant: Variant = eqx.field(static=True)
    columns: int = eqx.field(static=True)


def score(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    *,
    catalogue: Sequence[Effect] = CATALOGUE,
) -> FleetScores:
    """Score every catalogued effect that dwell means show, for all devices at once.

    **Arguments:** `dwells` leads with the device, see `stack_dwells`; `fit` is theirs, of `fit_fleet`. For a gyro the
    dwells' `accel` is the specific force in m/s², compensated.

    Forms of an effect are taken from the first device's plan. Amplitudes are in the effect's own unit.
    """
    signal = _signals(estimator, basis, dwells)
    first = jax.tree.map(lambda x: np.asarray(x)[0], signal)
    shapes = _shapes(first, catalogue, estimator.triad)
    coefficients = fit.parameters.reshape(len(fit.parameters), basis.size, -1)
    rows = _program(
        estimator,
        basis,
        shapes,
        jax.tree.map(jnp.asarray, dwells),
        signal,
        jnp.asarray(coefficients),
    )
    total = np.sqrt(np.square(fit.own_sigma) + np.square(fit.scatter)[:, None, None])
    weight = np.where(fit.valid[:, :, None], 1.0 / total, 0.0).reshape(len(total), -1)
    jacobian, signature = (np.asarray(x) * weight[:, :, None] for x in rows)
    residual = fit.misfit.reshape(len(total), -1) * weight
    left, kept = _beside(jacobian, signature, fit.covariance)
    square = np.einsum("dnt,dnt->dt", left, left)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = kept > ABSORBED
        amplitude = np.where(seen, np.einsum("dnt,dn->dt", left, residual) / square, np.nan)
        sigma = np.where(seen, 1.0 / np.sqrt(square), np.nan)
        unit = np.where(seen[:, None, :], left / np.sqrt(square)[:, None, :], 0.0)
    usable = np.all(np.isfinite(unit), axis=(1, 2))
    overlap = np.einsum("dns,dnt->st", unit[usable], unit[usable]) / max(int(usable.sum()), 1)
    return FleetScores(_terms(shapes, estimator.triad), amplitude, sigma, overlap)


def _beside(
    jacobian: np.ndarray, signature: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What is left of signatures beside the parameters, and which part of their size that is."""
    along = np.matmul(covariance, np.matmul(np.swapaxes(jacobian, 1, 2), signature))
    left = signature - np.matmul(jacobian, along)
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = np.linalg.norm(left, axis=1) / np.linalg.norm(signature, axis=1)
    return left, np.nan_to_num(kept)


@eqx.filter_jit
def _program(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    shapes: tuple[_Shape, ...],
    dwells: Dwells,
    signal: Signal,
    coefficients: Float[Array, "devices size parameters"],
) -> tuple[Array, Array]:
    """Jacobians of the misfit, `(devices, rows, unknowns)`, and signatures, `(devices, rows, terms)`."""

    def device(c: Array, mine: Dwells, felt: Signal) -> tuple[Array, Array]:
        added = [_addition(s, felt) for s in shapes]  # (dwells, 3, terms) each
        together = jnp.concatenate(added, axis=-1)
        phi = jax.vmap(basis)(mine.temperature)

        def one(p: Array, dwell: Dwells, change: Array) -> tuple[Array, Array]:
            vector = p @ c
            misfit = lambda v: estimator.misfit(v, dwell)[0]
            by_parameter = jax.jacfwd(misfit)(vector)  # (rows, parameters)

            def moved(output: Array) -> Array:
                where = lambda d: getattr(d, estimator.triad)
                return estimator.misfit(vector, eqx.tree_at(where, dwell, output))[0]

            by_output = jax.jacfwd(moved)(getattr(dwell, estimator.triad))  # (rows, 3)
            rows = jax.vmap(lambda r: jnp.kron(p, r))(by_parameter)
            return rows, by_output @ change

        jacobian, signature = jax.vmap(one)(phi, mine, together)
        return (
            jacobian.reshape(-1, jacobian.shape[-1]),
            signature.reshape(-1, signature.shape[-1]),
        )

    return jax.vmap(device)(coefficients, dwells, signal)


def _addition(shape: _Shape, signal: Signal) -> Float[Array, "dwells 3 terms"]:
    """Outputs that a unit of each term adds: one term for each channel and column, or for each column."""
    value = shape.effect.shape(signal, **shape.variant.settings)
    full = jnp.broadcast_to(value, (value.shape[0], 3, value.shape[2]))
    if shape.effect.common:
        return full
    channels = jnp.eye(3, dtype=full.dtype)[None, :, :, None] * full[:, :, None, :]
    return channels.reshape(full.shape[0], 3, 3 * full.shape[2])


def _shapes(signal: Signal, catalogue: Sequence[Effect], triad: str) -> tuple[_Shape, ...]:
    found: list[_Shape] = []
    for effect in catalogue:
        lacking = [k for k in effect.requires if getattr(signal, k) is None]
        if effect.name not in SEEN_IN_MEANS or triad not in effect.triads or lacking:
            continue
        variants = [v for v in effect.variants(signal) if v.settings.get("on", "bias") == "bias"]
        chosen = np.unique(np.linspace(0, len(variants) - 1, min(FORMS, len(variants))).round())
        for k in chosen.astype(int):
            variant = variants[k]
            value = jax.eval_shape(lambda s: effect.shape(s, **variant.settings), signal)  # noqa: B023
            found.append(_Shape(effect, variant, value.shape[2]))
    return tuple(found)


def _terms(shapes: Sequence[_Shape], triad: str) -> tuple[Term, ...]:
    made: list[Term] = []
    for shape in shapes:
        channels = ("all",) if shape.effect.common else tuple(f"{triad}_{a}" for a in "xyz")
        for channel in channels:
            for k in range(shape.columns):
                form = shape.variant.label + (f" [{k}]" if shape.columns > 1 else "")
                unit = shape.effect.units[triad]
                made.append(Term(shape.effect.name, channel, form, unit, shape.effect.common))
    return tuple(made)


def _signals(estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells) -> Signal:
    """What each device's triad went through, one row per dwell; arrays lead with the device."""
    temperature = np.asarray(dwells.temperature)
    known = bool(np.any(np.ptp(temperature, axis=1) > 0))
    low, high = float(temperature.min()), float(temperature.max())
    span = (low, max(high, low + 1.0)) if known else None
    devices = [
        _signal(estimator, basis, jax.tree.map(lambda x: np.asarray(x)[d], dwells), span)  # noqa: B023
        for d in range(len(temperature))
    ]
    return jax.tree.map(lambda *x: np.stack(x), *devices)


def _signal(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    span: tuple[float, float] | None,
) -> Signal:
    """One device's; `span` is the range of temperature in °C, `None` where it was not recorded."""
    time = np.asarray(dwells.time, float) - float(dwells.time[0])
    output = np.asarray(getattr(dwells, estimator.triad))
    force = _force(dwells)
    rate = None if dwells.reference_gyro is None else np.asarray(dwells.reference_gyro)
    given = force if estimator.triad == "accel" else rate
    low, high = (0.0, 1.0) if span is None else span
    return Signal(
        triad=estimator.triad,
        time=time,
        input=np.zeros_like(output) if given is None else given,
        output=output,
        since_power=time,
        since_start=time,
        since_move=np.zeros_like(time),
        move=np.zeros_like(output),
        at_rest=np.ones_like(time),
        temperature=None if span is None else np.asarray(dwells.temperature),
        temperature_rate=None if span is None else _heating(dwells),
        force=force,
        rate=rate,
        degree=basis.size - 1,
        low=low,
        high=high,
    )


def _force(dwells: Dwells) -> np.ndarray | None:
    """Specific force in units of its median size."""
    felt = dwells.accel if dwells.reference_accel is None else dwells.reference_accel
    if felt is None:
        return None
    size = float(np.median(np.linalg.norm(np.asarray(felt), axis=-1)))
    return np.asarray(felt) / (size or 1.0)


def _heating(dwells: Dwells) -> np.ndarray:
    """dT/dt in °C/s from dwell to dwell, within experiments."""
    step = np.diff(np.asarray(dwells.time, float))
    same = (np.diff(np.asarray(dwells.experiment)) == 0) & (step > 0)
    change = np.diff(np.asarray(dwells.temperature))
    slope = np.where(same, change / np.where(step > 0, step, 1.0), 0.0)
    total = np.append(slope, 0.0) + np.insert(slope, 0, 0.0)
    count = np.append(same, False).astype(float) + np.insert(same, 0, False)
    return total / np.maximum(count, 1.0)
