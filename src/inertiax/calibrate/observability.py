"""What the data do not tell: null space and weak combinations, in words; covariance of outputs."""

import numpy as np
from jaxtyping import Bool, Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Scalar, Vec3
from ..calibration.calibration import Calibration
from ..estimators import AbstractEstimator
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import AbstractBasis, Curve
from ..procedure.rank import kind_scale, TOLERANCE
from ..procedure.thermal_iterations import normal_matrix
from ..reduction.dwells import Dwells


ALIKE = 6  # decimals to which shares of a direction are compared: below lies rounding


class Observability(eqx.Module):
    """Singular values of the scaled Jacobian and the combinations that it does not see."""

    condition: float  # of the Jacobian with columns scaled to unit length; inf where rank deficient
    rank: int
    unknowns: int
    unseen: tuple[str, ...]  # one line per unobservable combination


def observability(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
) -> Observability:
    """Rank and condition of a plan at the ideal triad, before any estimate is trusted, by the rule of
    `procedure.rank`."""
    curve = Curve(basis, jnp.zeros((basis.size, estimator.num_parameters)))
    normal = np.asarray(eqx.filter_jit(normal_matrix)(estimator, curve, dwells))
    return judge_normal(normal, estimator.names, basis.size)


def judge_normal(
    normal: Float[np.ndarray, "unknowns unknowns"],
    names: tuple[str, ...],
    size: int,
) -> Observability:
    """As `observability`, from the normal matrix JᵀJ of the coefficients, row-major (size, names)."""
    safe = kind_scale(normal, names, size)
    values, vectors = np.linalg.eigh(normal / np.outer(safe, safe))
    singular = np.sqrt(np.clip(values, 0.0, None))
    small = singular <= TOLERANCE * singular.max()
    directions = _plain(vectors[:, small])
    unseen = tuple(_in_words(d / safe, names, size) for d in directions.T)
    smallest = float(singular.min())
    return Observability(
        condition=float("inf") if smallest == 0.0 else float(singular.max() / smallest),
        rank=int(np.sum(~small)),
        unknowns=len(singular),
        unseen=unseen,
    )


def _plain(space: np.ndarray) -> np.ndarray:
    """Directions that span the same space, each with one unknown that the others lack.

    Which basis an eigenvalue decomposition finds where singular values are alike is a matter of rounding. Unknowns
    are chosen by what of them lies in the space, the first one where some are alike.
    """
    left, chosen = space, []
    for _ in range(space.shape[1]):
        size = np.round(np.linalg.norm(left, axis=1), ALIKE)
        size[chosen] = 0.0
        chosen.append(int(np.argmax(size)))
        along = left[chosen[-1]] / np.linalg.norm(left[chosen[-1]])
        left = left - np.outer(left @ along, along)
    return space @ np.linalg.inv(space[sorted(chosen)])


def _in_words(direction: np.ndarray, names: tuple[str, ...], size: int) -> str:
    """The parameters that move together along a direction, largest first."""
    weight = np.abs(direction).reshape(size, len(names))
    # Compare like with like: a bias of 1 g counts as much as a matrix element of 1.
    unit = np.array([1.0 / 9.8 if n.startswith("accel.bias") else 1.0 for n in names])
    weight = weight * unit
    share = weight / np.linalg.norm(weight)
    order = np.argsort(-np.round(share, ALIKE), axis=None, kind="stable")[:4]
    parts = []
    for k in order:
        row, column = np.unravel_index(k, share.shape)
        if share[row, column] < 0.2:
            continue
        suffix = "" if size == 1 else f" (temperature term {row})"
        parts.append(f"{names[column]}{suffix}")
    return " with ".join(parts)


def sandwich_covariance(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, *, by: str = "dwell"
) -> Float[np.ndarray, "unknowns unknowns"]:
    """Covariance of the coefficients that does not trust the stated noise, row-major (size, parameters).

        C = c P (Σ_g s_g s_gᵀ) P,    P = (JᵀJ)⁻¹,   s_g = Σ_{i in g} J_iᵀ (E − H_i)⁻¹ᐟ² r_i,

    with groups g of one "dwell" each (noise of unlike sizes; residuals freed of their leverage, HC2) or of one
    "experiment" each (dwells of an experiment err together; plain residuals, c = G / (G − 1)). Where the noise
    model is right it equals P on average. Groups have to be many: with fewer experiments than unknowns the
    matrix is singular, and single deviations from it are optimistic.

    Raises `ValueError` for another grouping or a single group.

    **Reference:** MacKinnon and White, J. Econometrics 29 (1985) 305-325; Liang and Zeger, Biometrika 73
    (1986) 13-22.
    """
    if by not in ("dwell", "experiment"):
        raise ValueError(f"`sandwich_covariance(by={by!r})`: it is 'dwell' or 'experiment'.")
    residual, jacobian = (np.asarray(x) for x in _dwell_system(estimator, curve, dwells))
    normal = np.einsum("nru,nrv->uv", jacobian, jacobian)
    bread = scaled_inverse(normal)
    if by == "dwell":
        hat = np.einsum("nru,uv,nsv->nrs", jacobian, bread, jacobian)
        values, vectors = np.linalg.eigh(np.eye(hat.shape[1]) - hat)
        # A dwell of leverage 1 has no residual and tells nothing of its noise.
        root = np.where(values > 1e-9, 1.0 / np.sqrt(np.maximum(values, 1e-9)), 0.0)
        residual = np.einsum("nrk,nk,nsk,ns->nr", vectors, root, vectors, residual)
    scores = np.einsum("nru,nr->nu", jacobian, residual)
    factor = 1.0
    if by == "experiment":
        label = np.asarray(dwells.experiment)[np.asarray(dwells.valid)]
        groups, which = np.unique(label, return_inverse=True)
        if len(groups) < 2:
            raise ValueError(
                "`sandwich_covariance(by='experiment')`: one experiment has no spread."
            )
        summed = np.zeros((len(groups), scores.shape[1]))
        np.add.at(summed, which, scores[np.asarray(dwells.valid)])
        scores, factor = summed, len(groups) / (len(groups) - 1.0)
    return factor * bread @ (scores.T @ scores) @ bread


@eqx.filter_jit
def _dwell_system(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> tuple[Float[Array, "dwells rows"], Float[Array, "dwells rows unknowns"]]:
    """Whitened residual of every dwell and its Jacobian by the coefficients; zero where padding."""

    def one(dwell: Dwells) -> tuple[Array, Array]:
        vector, phi = curve(dwell.temperature), curve.basis(dwell.temperature)
        residual = estimator.residual(vector, dwell)
        jacobian = jax.jacfwd(estimator.residual)(vector, dwell)
        whole = jnp.einsum("a,ri->rai", phi, jacobian).reshape(len(residual), -1)
        weight = jnp.asarray(dwell.valid, whole.dtype)
        return weight * residual, weight * whole

    return jax.vmap(one)(dwells)


def curve_covariance_at(
    curve: Curve, covariance: Float[AnyArray, "unknowns unknowns"], temperature: Scalar | float
) -> Float[Array, "parameters parameters"]:
    """Covariance of all parameters at one temperature (°C): (φ ⊗ E)ᵀ C (φ ⊗ E)."""
    phi = curve.basis(temperature)
    count = jnp.shape(curve.coefficients)[1]
    blocks = jnp.asarray(covariance).reshape(phi.size, count, phi.size, count)
    return jnp.einsum("a,aibj,b->ij", phi, blocks, phi)


class OutputUncertainty(eqx.Module):
    """1 sigma of one compensated sample due to the calibration, and whether it can be relied on."""

    force: Float[Array, "3"]  # m/s²
    rate: Float[Array, "3"]  # rad/s
    extrapolated: Bool[Array, ""]  # outside the temperatures that the calibration covers


def output_uncertainty(
    calibration: Calibration, accel: Vec3, gyro: Vec3, temperature: Scalar | float
) -> OutputUncertainty:
    """Standard deviations of a compensated sample (of raw outputs) at any temperature, °C.

    Outside the calibration's range the deviation grows as the curves' own uncertainty does, but what
    the curves' form leaves out there is in no covariance: `extrapolated` says so.
    """
    force, rate = output_covariance(calibration, accel, gyro, temperature)
    return OutputUncertainty(
        force=jnp.sqrt(jnp.diagonal(force)),
        rate=jnp.sqrt(jnp.diagonal(rate)),
        extrapolated=calibration.extrapolates(temperature),
    )


def output_covariance(
    calibration: Calibration, accel: Vec3, gyro: Vec3, temperature: Scalar | float
) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
    """Covariance of the compensated outputs of one sample due to the calibration's uncertainty.

    First order: J P Jᵀ with J the derivative of the compensation with respect to the coefficients,
    for the specific force in (m/s²)² and the rate in (rad/s)². The sample's own noise is not in it.
    """

    def propagate(which: int, part: str) -> Array:
        triad = getattr(calibration, part)
        if triad is None:
            return jnp.zeros((3, 3))

        def compensated(coefficients: AnyArray) -> Array:
            changed = eqx.tree_at(
                lambda c: getattr(c, part).curve.coefficients, calibration, coefficients
            )
            return changed(accel, gyro, temperature)[which]

        jacobian = jax.jacfwd(compensated)(jnp.asarray(triad.curve.coefficients)).reshape(3, -1)
        return jacobian @ triad.covariance @ jacobian.T

    # The gyros' compensation also uses the compensated force, through the g-sensitivity.
    return propagate(0, "accel"), propagate(1, "gyro") + propagate(1, "accel")
