"""Errors of a rig that several dwells share, beside the dwells' own, in the least squares of one device.

Whitened dwell by dwell, the rows have the covariance V = E + U Uᵀ + W Wᵀ, where U holds the signatures of the angles
that dwells of one positioning share (`reduction.rig_errors`) and W those of the table's errors, which all share
(`reduction.table_errors`) or those through which an axis stands (`reduction.standing_axes`), for one standard deviation
each. Generalised least squares then has

    JᵀV⁻¹J = (S J)ᵀ (S J),     S = (E + W' W'ᵀ)^(−1/2) R,     W' = R W,     R = (E + U Uᵀ)^(−1/2)

(`numerics.common_errors`). A dwell is of one positioning at most, so that U falls into blocks of three angles. One
positioning turns both triads: where they are estimated together, their rows share its angles and the table's errors.
NumPy for NumPy, JAX for JAX.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .._jax import jax, jnp
from .._records import Module
from .._typing import AnyArray
from ..estimators import AbstractEstimator, JointImu
from ..estimators.base import whiten
from ..numerics.common_errors import inverse_root
from ..reduction.dwells import Dwells, is_told
from ..reduction.rig_errors import turned_by


class OfPositionings(Module):
    """What one standard deviation of each shared angle does to the rows of one device."""

    whitened: Float[AnyArray, "dwell row 3"]
    misfit: Float[AnyArray, "dwell row 3"]  # the same in SI
    each: Float[AnyArray, "dwell positioning"]  # 1 where the dwell is of the positioning
    inverse: Float[AnyArray, "positioning 3 3"]  # X of F = U X

    @property
    def signatures(self) -> Float[AnyArray, "row error"]:
        """U, a column an angle of a positioning."""
        library = np if isinstance(self.whitened, np.ndarray) else jnp
        blocks = library.einsum("nrk,ng->nrgk", self.whitened, self.each)
        return blocks.reshape(blocks.shape[0] * blocks.shape[1], -1)

    def times(self, left: AnyArray, rows: AnyArray) -> AnyArray:
        """left X Xᵀ Uᵀ rows, positioning by positioning."""
        library = np if isinstance(self.whitened, np.ndarray) else jnp
        seen = library.einsum("nrk,nrc->nkc", self.whitened, rows)
        sums = library.matmul(self.each.T, seen.reshape(len(seen), -1))
        sums = sums.reshape(-1, 3, rows.shape[-1])
        angles = library.matmul(self.inverse, library.matmul(self.inverse.swapaxes(1, 2), sums))
        own = library.matmul(self.each, angles.reshape(len(angles), -1))
        return library.einsum("nrk,nkc->nrc", left, own.reshape(len(seen), 3, -1))


class OfTable(Module):
    """What one standard deviation of each error of the table does to the rows of one device."""

    whitened: Float[AnyArray, "dwell row error"]  # W
    decorrelated: Float[AnyArray, "dwell row error"]  # W' = R W
    misfit: Float[AnyArray, "dwell row error"]  # W in SI, without what positionings share
    inverse: Float[AnyArray, "error error"]  # X of F = W' X

    def times(self, left: AnyArray, rows: AnyArray) -> AnyArray:
        """left X Xᵀ W'ᵀ rows."""
        library = np if isinstance(self.whitened, np.ndarray) else jnp
        seen = library.einsum("nrk,nrc->kc", self.decorrelated, rows)
        sizes = library.matmul(self.inverse, library.matmul(self.inverse.T, seen))
        return library.einsum("nrk,kc->nrc", left, sizes)


class SharedErrors(Module):
    """What dwells of one device share."""

    positionings: OfPositionings | None
    table: OfTable | None

    @property
    def signatures(self) -> Float[AnyArray, "row error"]:
        """U and W of the module, a column an error."""
        made = []
        if self.positionings is not None:
            made.append(self.positionings.signatures)
        if self.table is not None:
            whitened = self.table.whitened
            made.append(whitened.reshape(-1, whitened.shape[2]))
        library = np if isinstance(made[0], np.ndarray) else jnp
        return library.concatenate(made, axis=1)

    def decorrelated(
        self, rows: Float[AnyArray, "dwell row column"]
    ) -> Float[AnyArray, "dwell row column"]:
        """S times whitened rows, which then have unit covariance."""
        rows = self._without_positionings(rows)
        if self.table is None:
            return rows
        return rows - self.table.times(self.table.decorrelated, rows)

    def weighted(
        self, decorrelated: Float[AnyArray, "dwell row column"]
    ) -> Float[AnyArray, "dwell row column"]:
        """Sᵀ times decorrelated rows: of whitened rows x, V⁻¹ x."""
        rows = decorrelated
        if self.table is not None:
            rows = rows - self.table.times(self.table.decorrelated, rows)
        return self._without_positionings(rows)

    def of_misfit(
        self, misfit: Float[AnyArray, "dwell row"], residual: Float[AnyArray, "dwell row"]
    ) -> Float[AnyArray, "dwell row"]:
        """A misfit in SI without what its dwells share, so that its rows have the dwells' own noise; `residual` is
        the same whitened."""
        misfit, residual = misfit[..., None], residual[..., None]
        if self.positionings is not None:
            misfit = misfit - self.positionings.times(self.positionings.misfit, residual)
        if self.table is not None:
            residual = self._without_positionings(residual)
            misfit = misfit - self.table.times(self.table.misfit, residual)
        return misfit[..., 0]

    def _without_positionings(self, rows: AnyArray) -> AnyArray:
        """R rows."""
        if self.positionings is None:
            return rows
        return rows - self.positionings.times(self.positionings.whitened, rows)


def shared_errors(estimator: AbstractEstimator, dwells: Dwells) -> SharedErrors | None:
    """The shared errors that reach an estimator's rows of one device; `None` where there are none."""
    parts = (estimator.accel, estimator.gyro) if isinstance(estimator, JointImu) else (estimator,)
    if not any(part.by_reference for part in parts):  # such rows do not know the table's attitude
        return None
    positionings = _of_positionings(parts, dwells)
    table = _of_table(parts, dwells, positionings)
    return None if positionings is None and table is None else SharedErrors(positionings, table)


def _of_positionings(parts: tuple[AbstractEstimator, ...], dwells: Dwells) -> OfPositionings | None:
    number, shared = dwells.positioning, dwells.shared_angle
    if number is None or shared is None:
        return None
    library = np if isinstance(number, np.ndarray) else jnp
    # Several dwells share a positioning, so that there are half as many at most.
    most = int(number.max(initial=-1)) + 1 if library is np else len(number) // 2
    if most == 0:  # the dwells at hand are not of them
        return None
    each = (library.asarray(number)[:, None] == library.arange(most)[None]).astype(float)
    angle = library.asarray(shared)[:, None, None]
    made = lambda triad: angle * turned_by(library.asarray(getattr(dwells, f"reference_{triad}")))
    whitened, misfit = _rows(parts, dwells, made, 3, library)
    squares = library.einsum("nrk,nrl->nkl", whitened, whitened)
    gram = library.matmul(each.T, squares.reshape(len(squares), 9)).reshape(-1, 3, 3)
    return OfPositionings(whitened, misfit, each, inverse_root(gram))


def _of_table(
    parts: tuple[AbstractEstimator, ...], dwells: Dwells, positionings: OfPositionings | None
) -> OfTable | None:
    if dwells.table_accel is None or dwells.table_gyro is None:
        return None
    library = np if isinstance(dwells.table_accel, np.ndarray) else jnp
    made = lambda triad: library.asarray(getattr(dwells, f"table_{triad}"))
    num = dwells.table_accel.shape[-1]
    whitened, misfit = _rows(parts, dwells, made, num, library)
    decorrelated = whitened
    if positionings is not None:
        decorrelated = whitened - positionings.times(positionings.whitened, whitened)
        misfit = misfit - positionings.times(positionings.misfit, whitened)
    gram = library.einsum("nrk,nrl->kl", decorrelated, decorrelated)
    return OfTable(whitened, decorrelated, misfit, inverse_root(gram))


def _rows(
    parts: tuple[AbstractEstimator, ...],
    dwells: Dwells,
    made: Callable[[str], Float[AnyArray, "dwell 3 error"]],
    num: int,
    library,
) -> tuple[AnyArray, AnyArray]:
    """What `num` changes of the triads' references do to their rows, whitened and in SI."""
    found = [_of_triad(part, dwells, made, num, library) for part in parts]
    whitened, misfit = (library.concatenate(x, axis=1) for x in zip(*found, strict=True))
    return whitened, misfit


def _of_triad(
    estimator: AbstractEstimator,
    dwells: Dwells,
    made: Callable[[str], Float[AnyArray, "dwell 3 error"]],
    num: int,
    library,
) -> tuple[AnyArray, AnyArray]:
    """What `num` changes of a triad's references do to its rows, whitened and in SI."""
    if not estimator.by_reference:
        vector, first = jnp.zeros(estimator.num_parameters), dwells[0]
        rows = lambda: (estimator.residual(vector, first), estimator.misfit(vector, first)[0])
        none = [library.zeros((len(dwells.time), s.shape[0], num)) for s in jax.eval_shape(rows)]
        return none[0], none[1]
    triad = estimator.triad
    counted = library.asarray(dwells.valid)
    if triad == "accel":
        counted = counted & is_told(library.asarray(dwells.reference_accel))
    changed = library.where(counted[:, None, None], made(triad), 0.0)
    own = getattr(dwells, f"{triad}_covariance")
    if library is jnp:
        by_axis = jax.vmap(whiten, (None, None, 1), 1)
        return jax.vmap(by_axis, (0, None, 0))(own, estimator.scatter, changed), changed
    total = own + np.square(np.asarray(estimator.scatter)) * np.eye(3)
    return np.linalg.inv(np.linalg.cholesky(total)) @ changed, changed
