"""Errors of positionings that several dwells share, beside the dwells' own, in the least squares of one device.

Whitened dwell by dwell, the rows have the covariance V = E + U Uᵀ, where U holds the signatures of the shared angles
(`reduction.rig_errors`) for one standard deviation each. Generalised least squares then has

    JᵀV⁻¹J = (S J)ᵀ (S J),     S = V^(−1/2)     (`numerics.common_errors`)

A dwell is of one positioning at most, so that U falls into blocks of three angles. One positioning turns both triads:
where they are estimated together, their rows share its angles. NumPy for NumPy, JAX for JAX.
"""

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


class SharedErrors(Module):
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

    def decorrelated(
        self, rows: Float[AnyArray, "dwell row column"]
    ) -> Float[AnyArray, "dwell row column"]:
        """S times whitened rows, which then have unit covariance."""
        return rows - self._times(self.whitened, rows)

    def of_misfit(
        self, misfit: Float[AnyArray, "dwell row"], residual: Float[AnyArray, "dwell row"]
    ) -> Float[AnyArray, "dwell row"]:
        """A misfit in SI without what its dwells share, so that its rows have the dwells' own noise; `residual` is
        the same whitened."""
        return misfit - self._times(self.misfit, residual[..., None])[..., 0]

    def _times(self, left: AnyArray, rows: AnyArray) -> AnyArray:
        """left X Xᵀ Uᵀ rows, positioning by positioning."""
        library = np if isinstance(self.whitened, np.ndarray) else jnp
        seen = library.einsum("nrk,nrc->nkc", self.whitened, rows)
        sums = library.matmul(self.each.T, seen.reshape(len(seen), -1))
        sums = sums.reshape(-1, 3, rows.shape[-1])
        angles = library.matmul(self.inverse, library.matmul(self.inverse.swapaxes(1, 2), sums))
        own = library.matmul(self.each, angles.reshape(len(angles), -1))
        return library.einsum("nrk,nkc->nrc", left, own.reshape(len(seen), 3, -1))


def shared_errors(estimator: AbstractEstimator, dwells: Dwells) -> SharedErrors | None:
    """The shared errors that reach an estimator's rows of one device; `None` where there are none."""
    number, angle = dwells.positioning, dwells.shared_angle
    if number is None or angle is None:
        return None
    parts = (estimator.accel, estimator.gyro) if isinstance(estimator, JointImu) else (estimator,)
    if not any(part.by_reference for part in parts):  # such rows do not know the table's attitude
        return None
    library = np if isinstance(number, np.ndarray) else jnp
    # Several dwells share a positioning, so that there are half as many at most.
    most = int(number.max(initial=-1)) + 1 if library is np else len(number) // 2
    if most == 0:  # the dwells at hand are not of them
        return None
    each = (library.asarray(number)[:, None] == library.arange(most)[None]).astype(float)
    found = [_of_triad(part, dwells, library) for part in parts]
    whitened, misfit = (library.concatenate(x, axis=1) for x in zip(*found, strict=True))
    squares = library.einsum("nrk,nrl->nkl", whitened, whitened)
    gram = library.matmul(each.T, squares.reshape(len(squares), 9)).reshape(-1, 3, 3)
    return SharedErrors(whitened, misfit, each, inverse_root(gram))


def _of_triad(estimator: AbstractEstimator, dwells: Dwells, library) -> tuple[AnyArray, AnyArray]:
    """What one standard deviation of the dwells' shared angles does to a triad's rows, whitened and in SI."""
    if not estimator.by_reference:
        vector, first = jnp.zeros(estimator.num_parameters), dwells[0]
        rows = lambda: (estimator.residual(vector, first), estimator.misfit(vector, first)[0])
        none = [library.zeros((len(dwells.time), s.shape[0], 3)) for s in jax.eval_shape(rows)]
        return none[0], none[1]
    triad = estimator.triad
    reference = library.asarray(getattr(dwells, f"reference_{triad}"))
    counted = library.asarray(dwells.valid)
    if triad == "accel":
        counted = counted & is_told(reference)
    angle = library.where(counted, library.asarray(dwells.shared_angle), 0.0)
    turned = angle[:, None, None] * turned_by(reference)
    own = getattr(dwells, f"{triad}_covariance")
    if library is jnp:
        by_axis = jax.vmap(whiten, (None, None, 1), 1)
        return jax.vmap(by_axis, (0, None, 0))(own, estimator.scatter, turned), turned
    total = own + np.square(np.asarray(estimator.scatter)) * np.eye(3)
    return np.linalg.inv(np.linalg.cholesky(total)) @ turned, turned
