"""Score statistics of the catalogue over many devices: what a line's residuals have in common.

For a device with whitened misfit r, parameter Jacobian J, parameter covariance P and the signature s of a
catalogued effect (what a unit of it would add to the misfit), what the calibration cannot absorb of the
signature is s̃ = s − J P Jᵀ s, and

    amplitude = sᵀ r / sᵀ s̃,    sigma = 1 / √(sᵀ s̃)

is the estimate of the effect's size by one linear step: generalised least squares with the parameters
marginalised, whether or not they had a prior. It costs no further solve, so that it is taken for every
device and effect in one pass; `line` reads the answers over the whole fleet.

**Reference:** Rao's score test (1948); the projection is that of Frisch, Waugh and Lovell.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float

from ...effects import CATALOGUE, Effect, Signal, Variant
from ...estimators import AbstractEstimator
from ...physics.temperature import AbstractBasis
from ...procedure.shared_errors import shared_errors
from ...reduction.dwells import Dwells, known_force
from ..solve.batch import FleetFit


FORMS = 3  # of one effect, at most: spread over its grid
ABSORBED = 0.02  # part of a signature's size that must be left beside the calibration


class Term(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One effect in one form on one channel."""

    name: str
    channel: str  # "accel_x", or "all" for an effect of the rig
    form: str
    unit: str
    of_rig: bool


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One form of a catalogued effect: a term for each column and, unless it is of the rig, each channel."""

    name: str
    label: str
    settings: dict[str, float | int | str]  # whole numbers stay so in the manifest
    columns: int

    def __hash__(self) -> int:
        return hash((self.name, self.label, tuple(sorted(self.settings.items())), self.columns))

    @property
    def effect(self) -> Effect:
        """The catalogue's. Raises `ValueError` for a name that it does not have."""
        for effect in CATALOGUE:
            if effect.name == self.name:
                return effect
        raise ValueError(f"effect '{self.name}' is not in the catalogue.")


class FleetScores(eqx.Module):
    """Amplitudes of every term in every device. NaN where the plan does not show a term."""

    terms: tuple[Term, ...] = eqx.field(static=True)
    amplitude: Float[np.ndarray, "devices terms"]
    sigma: Float[np.ndarray, "devices terms"]
    # Mean correlation of what is left of two signatures.
    overlap: Float[np.ndarray, "terms terms"]


def score(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    *,
    forms: Sequence[Form] | None = None,
) -> FleetScores:
    """Score every catalogued effect that dwell means show, for all devices at once.

    **Arguments:** `dwells` leads with the device, see `stack_dwells`; `fit` is theirs. For a gyro the dwells'
    `accel` is the specific force in m/s², compensated. `forms` defaults to those of `choose_forms`.

    Amplitudes are in the effects' own units. Raises `ValueError` where no effect can be scored.
    """
    forms = choose_forms(estimator, basis, dwells) if forms is None else forms
    signal = _signals(estimator, basis, dwells)
    known = [f for f in forms if all(getattr(signal, k) is not None for k in f.effect.requires)]
    if not known:
        raise ValueError(
            f"`score`: no effect of the catalogue can be seen in these {estimator.triad} dwells."
        )
    amplitude, sigma, overlap = _scores(estimator, basis, tuple(known), dwells, signal, fit)
    terms, shown = terms_of(forms, estimator.triad), terms_of(known, estimator.triad)
    place = np.array([terms.index(t) for t in shown])
    full = np.full((2, len(amplitude), len(terms)), np.nan)
    full[:, :, place] = amplitude, sigma
    between = np.zeros((len(terms), len(terms)))
    between[np.ix_(place, place)] = overlap
    return FleetScores(terms, full[0], full[1], between)


def _scores(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    forms: tuple[Form, ...],
    dwells: Dwells,
    signal: Signal,
    fit: FleetFit,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitudes and their sigmas, `(devices, terms)`, and the mean overlap of the terms."""
    coefficients = jnp.asarray(fit.parameters.reshape(len(fit.parameters), basis.size, -1))
    numbers = jax.tree.map(jnp.asarray, dwells)
    rows = _program(estimator, basis, forms, numbers, signal, coefficients)
    total = np.sqrt(np.square(fit.own_sigma) + np.square(fit.scatter)[:, None, None])
    weight = np.where(fit.valid[:, :, None], 1.0 / total, 0.0).reshape(len(total), -1)
    jacobian, signature = (np.asarray(x) * weight[:, :, None] for x in rows)
    # Without what dwells share, as the fit has it
    residual = fit.misfit.reshape(len(total), -1) * weight
    jacobian, signature = _decorrelated(estimator, dwells, fit, (jacobian, signature))
    along = np.matmul(fit.covariance, np.matmul(np.swapaxes(jacobian, 1, 2), signature))
    left = signature - np.matmul(jacobian, along)
    square = np.einsum("dnt,dnt->dt", signature, left)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = square > np.square(ABSORBED) * np.einsum("dnt,dnt->dt", signature, signature)
        amplitude = np.where(seen, np.einsum("dnt,dn->dt", signature, residual) / square, np.nan)
        sigma = np.where(seen, 1.0 / np.sqrt(np.where(seen, square, 1.0)), np.nan)
    scale = np.nan_to_num(sigma)
    usable = np.all(np.isfinite(left), axis=(1, 2))
    products = np.matmul(np.swapaxes(signature[usable], 1, 2), left[usable])
    overlap = (products * scale[usable, :, None] * scale[usable, None, :]).sum(axis=0)
    return amplitude, sigma, overlap / max(int(usable.sum()), 1)


def _decorrelated(
    estimator: AbstractEstimator,
    dwells: Dwells,
    fit: FleetFit,
    rows: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened rows, `(devices, rows, columns)`, without the errors that dwells share."""
    if dwells.positioning is None and dwells.table_accel is None:
        return rows
    made = tuple(np.array(x) for x in rows)
    for k in range(len(fit.valid)):
        device = jax.tree.map(lambda x, k=k: np.asarray(x)[k], dwells)
        device = eqx.tree_at(lambda d: d.valid, device, fit.valid[k])
        scatter = np.asarray(float(fit.scatter[k]))
        shared = shared_errors(eqx.tree_at(lambda e: e.scatter, estimator, scatter), device)
        if shared is None:
            return rows
        for x in made:
            by_dwell = x[k].reshape(device.num_dwells, -1, x.shape[2])
            x[k] = np.asarray(shared.decorrelated(by_dwell)).reshape(x[k].shape)
    return made[0], made[1]


def choose_forms(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> tuple[Form, ...]:
    """The effects that dwell means show, each in at most three forms, for the first device's plan."""
    first = jax.tree.map(lambda x: np.asarray(x)[:1], dwells)
    signal = jax.tree.map(lambda x: np.asarray(x)[0], _signals(estimator, basis, first))
    found: list[Form] = []
    for effect in CATALOGUE:
        lacking = [k for k in effect.requires if getattr(signal, k) is None]
        if not effect.seen_in_means or estimator.triad not in effect.triads or lacking:
            continue
        variants = [v for v in effect.variants(signal) if v.settings.get("on", "bias") == "bias"]
        chosen = np.unique(np.linspace(0, len(variants) - 1, min(FORMS, len(variants))).round())
        for k in chosen.astype(int):
            columns = _columns(effect, variants[k], signal)
            found.append(Form(effect.name, variants[k].label, dict(variants[k].settings), columns))
    return tuple(found)


def _columns(effect: Effect, variant: Variant, signal: Signal) -> int:
    return jax.eval_shape(lambda s: effect.shape(s, **variant.settings), signal).shape[2]


def terms_of(forms: Sequence[Form], triad: str) -> tuple[Term, ...]:
    """What each number of a score stands for."""
    made: list[Term] = []
    for form in forms:
        effect = form.effect
        channels = ("all",) if effect.common else tuple(f"{triad}_{a}" for a in "xyz")
        for channel in channels:
            for k in range(form.columns):
                label = form.label + (f" [{k}]" if form.columns > 1 else "")
                unit = effect.unit(triad, form.settings, k)
                made.append(Term(effect.name, channel, label, unit, effect.common))
    return tuple(made)


@eqx.filter_jit
def _program(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    forms: tuple[Form, ...],
    dwells: Dwells,
    signal: Signal,
    coefficients: Float[Array, "devices size parameters"],
) -> tuple[Array, Array]:
    """Jacobians of the misfit, `(devices, rows, unknowns)`, and signatures, `(devices, rows, terms)`."""

    def device(c: Array, mine: Dwells, felt: Signal) -> tuple[Array, Array]:
        added = [_addition(f, felt) for f in forms]  # (dwells, 3, terms) each
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


def _addition(form: Form, signal: Signal) -> Float[Array, "dwells 3 terms"]:
    """Outputs that a unit of each term adds."""
    effect = form.effect
    value = effect.shape(signal, **form.settings)
    full = jnp.broadcast_to(value, (value.shape[0], 3, value.shape[2]))
    if effect.common:
        return full
    channels = jnp.eye(3, dtype=full.dtype)[None, :, :, None] * full[:, :, None, :]
    return channels.reshape(full.shape[0], 3, 3 * full.shape[2])


def _signals(estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells) -> Signal:
    """What each device's triad went through, one row per dwell; arrays lead with the device."""
    temperature = np.asarray(dwells.temperature)
    known = bool(np.any(np.ptp(temperature, axis=1) > 0))
    low, high = float(temperature.min()), float(temperature.max())
    span = (low, max(high, low + 1.0)) if known else None
    numbers = jax.tree.map(np.asarray, dwells)
    devices = [_signal(estimator, basis, numbers[d], span) for d in range(len(temperature))]
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
        rate_change=None if rate is None else np.zeros_like(rate),  # a dwell's is constant
        degree=basis.size - 1,
        low=low,
        high=high,
    )


def _force(dwells: Dwells) -> np.ndarray | None:
    """Specific force in units of its median size."""
    felt = known_force(dwells.reference_accel, dwells.accel)
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
