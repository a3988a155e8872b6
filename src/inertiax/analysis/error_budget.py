"""How the answer depends on everything that went into it: rig, environment, noise, single dwells.

A `Source` is an uncertainty of the rig or the device that disturbs what the dwells should have read:
`table_angles`, `gravity`, `probe_noise`, … . `answer` is the calibration as one differentiable function of
all of them, C(u), by the implicit function theorem through the least squares; `error_budget` takes its
derivative at zero and gives what each source contributes to each coefficient,

    Cov_s = (∂C/∂u_s) (∂C/∂u_s)ᵀ      with u_s in standard deviations.

`influence` tells what a single dwell does to the answer.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._typing import AnyArray, Vec3
from ..estimators import AbstractEstimator
from ..numerics.linear_algebra import scaled_inverse, spd_inverse
from ..physics.error_model import AccelerometerErrors, compensate_accel
from ..physics.leaves import is_traced
from ..physics.temperature import Curve
from ..procedure.thermal_iterations import dwell_residuals, joint_fit, normal_matrix
from ..reduction.dwells import Dwells, known_force
from .force_on_gyros import by_force, feels_force
from .sources import Scene, Source


def make_scene(estimator: AbstractEstimator, curve: Curve, dwells: Dwells) -> Scene:
    """What the dwells felt: references where the plan gives them, else what the outputs say."""
    return Scene(
        force=_felt_force(estimator, curve, dwells),
        rate=None if dwells.reference_gyro is None else jnp.asarray(dwells.reference_gyro),
        heating=jnp.asarray(heating(dwells)),
    )


def _felt_force(estimator: AbstractEstimator, curve: Curve, dwells: Dwells) -> Array | None:
    if estimator.triad != "accel" or dwells.reference_accel is not None or dwells.accel is None:
        force = known_force(dwells.reference_accel, dwells.accel)
        return None if force is None else jnp.asarray(force)

    def one(temperature: Array, output: Array) -> Array:
        return compensate_accel(_errors(estimator, curve(temperature)), output)

    return jax.vmap(one)(jnp.asarray(dwells.temperature), jnp.asarray(dwells.accel))


def _errors(estimator: AbstractEstimator, vector: Array) -> AccelerometerErrors:
    errors = estimator.unpack(vector)
    assert isinstance(errors, AccelerometerErrors)
    return errors


def heating(dwells: Dwells) -> Float[Array, " dwells"]:
    """dT/dt at each dwell, °C/s, by central differences within its experiment; zero where it has no neighbour."""
    valid, label = jnp.asarray(dwells.valid), jnp.asarray(dwells.experiment)
    order = jnp.lexsort((jnp.asarray(dwells.time), label, ~valid))
    time, temperature = (jnp.asarray(x)[order] for x in (dwells.time, dwells.temperature))
    near = (label[order][1:] == label[order][:-1]) & valid[order][1:]
    zero, none = jnp.zeros((1,), time.dtype), jnp.zeros((1,), bool)
    step = jnp.where(near, jnp.diff(time), 1.0)
    slope = jnp.where(near, jnp.diff(temperature) / jnp.where(step != 0.0, step, 1.0), 0.0)
    # By Fornberg's weights for unequal steps: each side's slope weighs with the other side's step.
    before, after = jnp.concatenate([none, near]), jnp.concatenate([near, none])
    h0, h1 = jnp.concatenate([zero, step]), jnp.concatenate([step, zero])
    s0, s1 = jnp.concatenate([zero, slope]), jnp.concatenate([slope, zero])
    w0, w1 = (
        jnp.where(before, jnp.where(after, h1, 1.0), 0.0),
        jnp.where(after, jnp.where(before, h0, 1.0), 0.0),
    )
    total = w0 + w1
    rate = (w0 * s0 + w1 * s1) / jnp.where(total > 0.0, total, 1.0)
    return jnp.zeros_like(rate).at[order].set(rate)


def _groups(source: Source, dwells: Dwells) -> tuple[Int[AnyArray, " dwells"], int]:
    """Which draw each dwell takes, its own, its experiment's or the campaign's, and how many draws there are.

    In traced code an experiment's draw has the number of its first dwell, as the count must be known.
    """
    count = dwells.num_dwells
    if source.per == "dwell":
        return np.arange(count), count
    if source.per == "campaign":
        return np.zeros(count, int), 1
    label = dwells.experiment
    if is_traced(label):
        same = jnp.asarray(label)[:, None] == jnp.asarray(label)[None, :]
        return jnp.argmax(same, axis=1), count
    found = np.unique(np.asarray(label), return_inverse=True)[1]
    return found, int(found.max()) + 1


def no_draws(sources: Sequence[Source], dwells: Dwells) -> list[Float[Array, "_ _"]]:
    """Zero disturbance of every source: the point at which derivatives are taken."""
    return [jnp.zeros((_groups(s, dwells)[1], s.width)) for s in sources]


def disturbed(
    dwells: Dwells,
    scene: Scene,
    curve: Curve,
    estimator: AbstractEstimator,
    sources: Sequence[Source],
    draws: Sequence[Float[AnyArray, "_ _"]],
) -> Dwells:
    """The dwells as they would have been, had each source been off by `draws` standard deviations.

    What happens to the specific force or the rate goes through the device's own (E + Γ), (E + Θ) and D;
    references and covariances stay what the station stated.
    """
    for source, own in zip(sources, draws, strict=True):
        values = jnp.asarray(own)[_groups(source, dwells)[0]]
        dwells = _disturbed_by(source, values, dwells, scene, curve, estimator)
    return dwells


def _disturbed_by(
    source: Source,
    draws: Float[AnyArray, "dwells _"],
    dwells: Dwells,
    scene: Scene,
    curve: Curve,
    estimator: AbstractEstimator,
) -> Dwells:
    """One source alone, with the draw of each dwell."""
    change = source.effect(jnp.asarray(source.size) * jnp.asarray(draws), scene, dwells)
    turned = by_force(estimator, curve, dwells, change.force)
    if estimator.triad == "accel" or not change.with_calibration:
        dwells = _add(dwells, "accel", _through(estimator, curve, dwells, "accel", change.force))
    dwells = _add(dwells, "gyro", _through(estimator, curve, dwells, "gyro", change.rate))
    dwells = _add(dwells, "gyro", turned)
    dwells = _add(dwells, "accel", change.accel)
    dwells = _add(dwells, "gyro", change.gyro)
    return _add(dwells, "temperature", change.temperature)


def _through(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, triad: str, change: Array | None
) -> Array | None:
    """A change of what was felt, as the outputs show it; an ideal triad where it is not estimated."""
    if change is None or estimator.triad != triad:
        return change

    def one(temperature: Array, felt: Array) -> Array:
        return felt + jnp.asarray(estimator.unpack(curve(temperature)).matrix) @ felt

    return jax.vmap(one)(jnp.asarray(dwells.temperature), change)


def _add(dwells: Dwells, column: str, change: Array | None) -> Dwells:
    value = getattr(dwells, column)
    if change is None or value is None:
        return dwells
    return eqx.tree_at(lambda d: getattr(d, column), dwells, jnp.asarray(value) + change)


def answer(
    estimator: AbstractEstimator,
    curve: Curve,
    dwells: Dwells,
    sources: Sequence[Source],
    draws: Sequence[Float[AnyArray, "_ _"]],
    scene: Scene | None = None,
) -> Float[Array, "size parameters"]:
    """Coefficients of the joint fit as a differentiable function of what went wrong.

    **Arguments:** `curve` is the undisturbed answer (start and place of linearisation); `draws` holds one
    array per source, in standard deviations, shaped as `no_draws` gives it. Differentiate it with
    respect to `draws`, or, because everything is a pytree, to dwells, g or an estimator's fields.
    """
    scene = make_scene(estimator, curve, dwells) if scene is None else scene
    moved = disturbed(dwells, scene, curve, estimator, sources, draws)
    solution = joint_fit(estimator, curve.basis, moved, start=curve.coefficients)
    return jnp.asarray(solution.curve.coefficients)


class Budget(eqx.Module):
    """What each source contributes to the coefficients, first order."""

    sources: tuple[Source, ...]
    curve: Curve
    parameters: tuple[str, ...] = eqx.field(static=True)
    derivatives: tuple[Float[np.ndarray, "unknowns _"], ...]  # per standard deviation

    def covariance(self, number: int) -> Float[np.ndarray, "unknowns unknowns"]:
        """Covariance of the coefficients, row-major (size, parameters), from one source."""
        return self.derivatives[number] @ self.derivatives[number].T

    def through(
        self, gradient: Float[AnyArray, "outputs unknowns"]
    ) -> Float[np.ndarray, "sources outputs"]:
        """1 sigma from each source of anything whose derivative by the coefficients is `gradient`."""
        rows = np.asarray(gradient)
        return np.stack([np.sqrt(np.sum(np.square(rows @ d), axis=1)) for d in self.derivatives])

    def at(self, temperature: float) -> Float[np.ndarray, "sources parameters"]:
        """1 sigma of every parameter at one temperature (°C), from each source."""
        phi = np.asarray(self.curve.basis(jnp.asarray(float(temperature))))
        return self.through(np.kron(phi[None, :], np.eye(len(self.parameters))))


def error_budget(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, sources: Sequence[Source]
) -> Budget:
    """Derivative of the answer by every source, at the answer (`curve`, a minimum of f = ½ ‖r‖²):

        dC/du = −(∂²f/∂C²)⁻¹ ∂²f/∂C∂u

    by the implicit function theorem, the same as the derivative of `answer` without solving again.

    Raises `ValueError` where a source does not touch anything that the dwells hold.
    """
    check_sources(estimator, curve, dwells, sources)
    found = source_derivatives(estimator, curve, dwells, sources)
    return Budget(tuple(sources), curve, estimator.names, tuple(np.asarray(x) for x in found))


def check_sources(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, sources: Sequence[Source]
) -> None:
    """Raise `ValueError` where a source does not touch anything that the dwells hold."""
    scene = make_scene(estimator, curve, dwells)
    for source in sources:
        change = source.effect(jnp.zeros((dwells.num_dwells, source.width)), scene, dwells)
        turned = change.force is not None and feels_force(estimator)
        if not change.touches(dwells) and not (turned and dwells.gyro is not None):
            raise ValueError(
                f"`error_budget(...)`: the source '{source.name}' changes nothing that these dwells "
                f"hold; leave it out or give dwells with the column that it disturbs."
            )


def source_derivatives(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, sources: Sequence[Source]
) -> tuple[Float[Array, "unknowns _"], ...]:
    """Derivative of the coefficients by each source's draws, in standard deviations; pure, see `error_budget`."""
    dwells = estimator.usable(dwells)
    scene = make_scene(estimator, curve, dwells)
    inverse, mixed = _second_derivatives(estimator, curve, dwells)

    def derivative(source: Source) -> Array:
        # A disturbance reaches its own dwell only: by chain rule dwell by dwell, summed over a draw's dwells.
        felt = _column_slopes(source, dwells, scene, curve, estimator)
        each = jnp.einsum("nuk,nkw->nuw", mixed, felt)
        groups, count = _groups(source, dwells)
        rows = jax.ops.segment_sum(each, groups, count)
        flat = jnp.moveaxis(rows, 1, 0).reshape(len(inverse), -1)
        return -inverse @ flat

    return tuple(derivative(s) for s in sources)


_Columns = dict[str, Array]


def _columns(dwells: Dwells) -> _Columns:
    """What sources disturb, of those columns that the dwells hold."""
    names = ("accel", "gyro", "temperature")
    return {n: jnp.asarray(v) for n in names if (v := getattr(dwells, n)) is not None}


@eqx.filter_jit
def _second_derivatives(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> tuple[Float[Array, "unknowns unknowns"], Float[Array, "dwells unknowns columns"]]:
    """(∂²f/∂C²)⁻¹ of f = ½ ‖r‖², and what each dwell's columns x add: ∂²f/∂C∂x, x as in `_columns`."""

    def one(dwell: Dwells) -> tuple[Array, Array, Array]:
        def half_chi2(vector: Array, columns: _Columns) -> Array:
            moved = eqx.tree_at(
                lambda d: [getattr(d, n) for n in columns], dwell, [*columns.values()]
            )
            return 0.5 * jnp.sum(jnp.square(estimator.residual(vector, moved)))

        columns, temperature = _columns(dwell), jnp.asarray(dwell.temperature)
        phi, phi_slope = jax.jvp(curve.basis, (temperature,), (jnp.ones_like(temperature),))
        coefficients = jnp.asarray(curve.coefficients)
        slope = jax.grad(half_chi2)
        by_vector = slope(phi @ coefficients, columns)
        own, by_columns = jax.jacfwd(slope, argnums=(0, 1))(phi @ coefficients, columns)
        # θ = φ(T) C, so that the temperature acts through the curve, too.
        by_columns["temperature"] = by_columns["temperature"] + own @ (phi_slope @ coefficients)
        flat = jnp.concatenate([x.reshape(len(by_vector), -1) for x in by_columns.values()], axis=1)
        mixed = phi[:, None, None] * flat[None]
        last = phi_slope[:, None] * by_vector[None]
        mixed = mixed.at[..., -1].add(last).reshape(-1, flat.shape[1])
        weight = jnp.asarray(dwell.valid, temperature.dtype)
        return phi, weight * own, weight * mixed

    phis, hessians, mixed = jax.vmap(one)(dwells)
    unknowns = jnp.size(curve.coefficients)
    hessian = jnp.einsum("na,nb,nij->aibj", phis, phis, hessians).reshape(unknowns, unknowns)
    return spd_inverse(hessian), mixed


def _column_slopes(
    source: Source, dwells: Dwells, scene: Scene, curve: Curve, estimator: AbstractEstimator
) -> Float[Array, "dwells columns width"]:
    """Derivative of every dwell's columns (`_columns`) by its own draw of a source, at zero."""
    zero = jnp.zeros((dwells.num_dwells, source.width))
    moved = lambda draws: _columns(_disturbed_by(source, draws, dwells, scene, curve, estimator))

    def along(direction: Array) -> Array:
        # The same direction for all dwells at once: none feels another's.
        slopes = jax.jvp(moved, (zero,), (jnp.tile(direction[None], (len(zero), 1)),))[1]
        return jnp.concatenate([x.reshape(len(zero), -1) for x in slopes.values()], axis=1)

    return jax.jit(jax.vmap(along, out_axes=2))(jnp.eye(source.width))


def magnitude_gradient(
    estimator: AbstractEstimator, curve: Curve, temperature: float, direction: Vec3, gravity: float
) -> Float[np.ndarray, "1 unknowns"]:
    """∂(|a| − g)/∂C of a compensated rest: its specific force is g along `direction` (case frame)."""
    t = jnp.asarray(float(temperature))
    unit = jnp.asarray(direction) / jnp.linalg.norm(jnp.asarray(direction))
    errors = _errors(estimator, curve(t))
    output = gravity * (unit + jnp.asarray(errors.matrix) @ unit) + errors.bias

    def magnitude(flat: Array) -> Array:
        own = Curve(curve.basis, flat.reshape(jnp.shape(curve.coefficients)))
        return jnp.linalg.norm(compensate_accel(_errors(estimator, own(t)), output))

    return np.asarray(jax.grad(magnitude)(jnp.asarray(curve.coefficients).reshape(-1)))[None, :]


# Single dwells -----------------------------------------------------------------------------------


class Influence(eqx.Module):
    """What single dwells do to the answer."""

    leverage: Float[np.ndarray, " dwells"]  # trace of the dwell's block of the hat matrix
    distance: Float[np.ndarray, " dwells"]  # Cook's: squared move in sigmas over the unknowns
    shift: Float[np.ndarray, "dwells size parameters"]  # of the coefficients, were it left out


def influence(estimator: AbstractEstimator, curve: Curve, dwells: Dwells) -> Influence:
    """Leverage, Cook's distance and the move of the answer when a dwell is left out, for each dwell.

    With J_i, r_i the dwell's whitened Jacobian and residual, P = (JᵀJ)⁻¹ and H_i = J_i P J_iᵀ,

        leverage = tr H_i,   shift = P J_iᵀ (E − H_i)⁻¹ r_i,   distance = shiftᵀ P⁻¹ shift / p.

    The sum of the leverages is the number of unknowns. A dwell without which the problem would be
    singular has an infinite shift.

    **Reference:** Cook and Weisberg, *Residuals and Influence in Regression*, 1982, ch. 3.
    """
    jacobian = np.asarray(_dwell_jacobians(estimator, curve, dwells))
    residual = np.asarray(eqx.filter_jit(dwell_residuals)(estimator, curve, dwells))
    normal = np.asarray(eqx.filter_jit(normal_matrix)(estimator, curve, dwells))
    inverse = scaled_inverse(normal)
    gain = np.einsum("uv,nrv->nur", inverse, jacobian)
    hat = np.einsum("nru,nus->nrs", jacobian, gain)
    rows = residual.shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.eye(rows) - hat
        singular = np.min(np.abs(np.linalg.eigvalsh(left)), axis=1) < 1e-9
        freed = np.linalg.solve(
            np.where(singular[:, None, None], np.eye(rows), left), residual[..., None]
        )
    shift = np.einsum("nur,nr->nu", gain, freed[..., 0])
    shift[singular] = np.inf
    distance = np.full(len(shift), np.inf)
    moved = shift[~singular]
    distance[~singular] = np.einsum("nu,uv,nv->n", moved, normal, moved) / normal.shape[0]
    return Influence(
        leverage=np.trace(hat, axis1=1, axis2=2),
        distance=distance,
        shift=shift.reshape(-1, *np.shape(curve.coefficients)),
    )


@eqx.filter_jit
def _dwell_jacobians(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> Float[Array, "dwells rows unknowns"]:
    def one(dwell: Dwells) -> Array:
        phi = curve.basis(dwell.temperature)
        jacobian = jax.jacfwd(estimator.residual)(curve(dwell.temperature), dwell)
        whole = jnp.einsum("a,ri->rai", phi, jacobian).reshape(jacobian.shape[0], -1)
        return jnp.asarray(dwell.valid, whole.dtype) * whole

    return jax.vmap(one)(estimator.usable(dwells))
