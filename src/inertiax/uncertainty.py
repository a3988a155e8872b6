"""What the data do not tell: null space and weak combinations, in words; covariance of outputs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._typing import AnyArray, Scalar, Vec3
from .calibration import Calibration
from .dwells import Dwells
from .estimators import AbstractEstimator
from .procedure import normal_matrix
from .temperature import AbstractBasis, Curve


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
    *,
    tolerance: float = 1e-4,
) -> Observability:
    """Rank and condition of a plan at the ideal triad, before any estimate is trusted.

    Parameters of one kind (biases, matrix elements, g-sensitivities) and temperature term are scaled
    alike, by the best determined of them, so that a weak one shows. `tolerance` is the singular value,
    relative to the largest, below which a combination counts as unobservable: its standard deviation
    would be 10⁴ times that of the best determined one, and the linearisation on which every estimate
    rests would not hold.
    """
    curve = Curve(basis, jnp.zeros((basis.size, estimator.num_parameters)))
    normal = np.asarray(eqx.filter_jit(normal_matrix)(estimator, curve, dwells))
    return judge_normal(normal, estimator.names, basis.size, tolerance=tolerance)


def judge_normal(
    normal: Float[np.ndarray, "unknowns unknowns"],
    names: tuple[str, ...],
    size: int,
    *,
    tolerance: float = 1e-4,
) -> Observability:
    """As `observability`, from the normal matrix JᵀJ of the coefficients, row-major (size, names)."""
    safe = _common_scale(np.sqrt(np.diagonal(normal)), names, size)
    values, vectors = np.linalg.eigh(normal / np.outer(safe, safe))
    singular = np.sqrt(np.clip(values, 0.0, None))
    small = singular < tolerance * singular.max()
    unseen = tuple(_in_words(vectors[:, k] / safe, names, size) for k in np.flatnonzero(small))
    smallest = float(singular.min())
    return Observability(
        condition=float("inf") if smallest == 0.0 else float(singular.max() / smallest),
        rank=int(np.sum(~small)),
        unknowns=len(singular),
        unseen=unseen,
    )


def _common_scale(columns: np.ndarray, names: tuple[str, ...], size: int) -> np.ndarray:
    """Column scales that keep what is weak weak: parameters of one kind share the kind's largest."""
    columns = columns.reshape(size, len(names))
    kinds = [name.split("[")[0] for name in names]
    scale = np.empty_like(columns)
    for kind in set(kinds):
        members = [k for k, own in enumerate(kinds) if own == kind]
        scale[:, members] = columns[:, members].max(axis=1, keepdims=True)
    return np.where(scale > 0.0, scale, 1.0).reshape(-1)


def _in_words(direction: np.ndarray, names: tuple[str, ...], size: int) -> str:
    """The parameters that move together along a direction, largest first."""
    weight = np.abs(direction).reshape(size, len(names))
    # Compare like with like: a bias of 1 g counts as much as a matrix element of 1.
    unit = np.array([1.0 / 9.8 if n.startswith("accel.bias") else 1.0 for n in names])
    weight = weight * unit
    share = weight / np.linalg.norm(weight)
    order = np.argsort(-share, axis=None)[:4]
    parts = []
    for k in order:
        row, column = np.unravel_index(k, share.shape)
        if share[row, column] < 0.2:
            continue
        suffix = "" if size == 1 else f" (temperature term {row})"
        parts.append(f"{names[column]}{suffix}")
    return " with ".join(parts)


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
