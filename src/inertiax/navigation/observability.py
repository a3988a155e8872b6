"""Which calibration coefficients a run's motion shows: the filter's own information, compared with its prior.

With Ψ_k the transition of errors from the start to segment k (drift left out, nothing but constants and kinematics),

    I = Σ_k (H_k Ψ_k)ᵀ R_k⁻¹ (H_k Ψ_k)

is the observability Gramian weighted by what the measurements are worth. The navigation states, whose prior at the
start counts,
are eliminated (Schur complement), and the rest is put in units of the calibration's prior, whose covariance becomes the
identity. An eigenvalue λ then tells a direction of coefficients whose standard deviation the run brings to 1/√(1 +
λ) of the
prior. Where a motion is degenerate - a rate or a specific force that is constant along an axis, a temperature that
does not
change - columns of the model are proportional to the bias, and directions with λ = 0 appear.

It leaves out the process noise, so that a direction counted as unobservable is so with any IMU's noise.

**Reference:** Yang, Geneva, Zuo and Huang, "Online self-calibration for visual-inertial navigation: models, analysis
and
degeneracy", IEEE Trans. Robotics 39 (2023), 3479-3498 (arXiv 2201.09170): the primitive degenerate motions of IMU
intrinsics.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics.wide_arithmetic import in_64_bits
from ..physics.leaves import is_traced
from .checks import check_one_run
from .filter import Correction, Filter, Track
from .filter_state import NAVIGATION
from .segment import Transition


class Thresholds(eqx.Module):
    """What counts as unobservable; conventions, stated so that they can be changed."""

    # Information of a direction relative to its prior: below it, the run takes less than 0.5 % off a standard
    # deviation, which no later run would notice.
    information: float = 0.01
    # Share of a coefficient's prior variance that lies in unobservable directions.
    share: float = 0.05


class Observability(eqx.Module):
    """What a run's motion shows of the calibration states."""

    names: tuple[str, ...] = eqx.field(static=True)  # as `Filter.names`
    information: Float[np.ndarray, " directions"]  # λ, ascending, relative to the prior
    directions: Float[np.ndarray, "directions states"]  # each in prior standard deviations
    # Of each state's prior variance, in unobservable directions
    share: Float[np.ndarray, " states"]
    reduction: Float[np.ndarray, " states"]  # of each state's standard deviation, posterior/prior
    # Coefficients in unobservable directions
    unobservable: tuple[str, ...] = eqx.field(static=True)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters of which at least one coefficient is unobservable, such as `gyro.matrix[0,1]`."""
        return tuple(dict.fromkeys(n.split(" of ")[0] for n in self.unobservable))

    def statement(self) -> str:
        """One sentence for a report; states without prior variance are known, and not shown by a run."""
        varying = int(np.any(self.directions != 0.0, axis=0).sum())
        exact = len(self.names) - varying
        known = f" ({exact} without prior variance left out)" if exact else ""
        if not self.unobservable:
            return f"The run's motion shows all {varying} calibration states{known}."
        count = int(np.sum(self.share > 0.0))
        return (
            f"The run's motion leaves combinations of {count} of {varying} calibration states "
            f"unobservable{known}: {', '.join(self.parameters)}."
        )


def observability(
    filter_: Filter, track: Track, thresholds: Thresholds | None = None
) -> Observability:
    """The calibration states that a run shows and those that it cannot, from the filter's own linearisation.

    Raises `ValueError` for a filter without calibration states, for several runs in one track, and in traced code.
    """
    if any(is_traced(x) for x in jax.tree.leaves((filter_, track))):
        raise ValueError(
            "`observability(filter_, track)`: does not work in traced code; call it with the track that came out of it."
        )
    check_one_run(
        "observability(filter_, track)", track.time, "`jax.tree.map(lambda x: x[k], track)`"
    )
    states = filter_.model.states
    count, thresholds = len(states.names), thresholds or Thresholds()
    if not count:
        raise ValueError("`observability(filter_, track)`: the filter has no calibration states.")
    # Rounding of large terms that cancel: in 32 bits it hides what a run shows.
    gramian = np.asarray(in_64_bits("observability", _gramian, track.transition, track.corrections))
    prior = np.asarray(track.start.covariance, float)[:NAVIGATION, :NAVIGATION]
    unit, shown = _prior_directions(np.asarray(states.correlation, float))
    whole = unit.T @ _eliminated(gramian, prior) @ unit
    information, turned = np.linalg.eigh(0.5 * (whole + whole.T))
    information = np.maximum(information, 0.0)
    directions = unit @ turned
    unseen = information < thresholds.information
    variance = np.sum(directions**2, axis=1)
    share = np.divide(
        np.sum(directions[:, unseen] ** 2, axis=1), variance, out=np.zeros(count), where=shown
    )
    after = np.sum(directions**2 / (1.0 + information), axis=1)
    reduction = np.sqrt(np.divide(after, variance, out=np.ones(count), where=shown))
    share = np.where(share > thresholds.share, share, 0.0)
    names = filter_.names
    unobservable = tuple(n for n, s in zip(names, share, strict=True) if s > 0.0)
    return Observability(names, information, directions.T, share, reduction, unobservable)


@eqx.filter_jit
def _gramian(
    transition: Transition, corrections: tuple[Correction, ...]
) -> Float[Array, "states states"]:
    """Σ (HΨ)ᵀ R⁻¹ HΨ over navigation and calibration states, drift states left out."""
    slow = transition.decay.shape[1]
    others = transition.others[:, :, slow:]
    count = others.shape[2]
    start = jnp.eye(NAVIGATION, NAVIGATION + count, dtype=others.dtype)

    def one(moved: tuple[Array, Array], inputs: tuple) -> tuple[tuple[Array, Array], None]:
        chain, total = moved
        navigation, calibrated, measured = inputs
        chain = navigation @ chain
        chain = chain.at[:, NAVIGATION:].add(calibrated)
        for m in measured:
            rows = m.slope[:, :NAVIGATION] @ chain
            rows = rows.at[:, NAVIGATION:].add(m.slope[:, NAVIGATION + slow :])
            total = total + rows.T @ (rows / m.variance[:, None])
        return (chain, total), None

    empty = jnp.zeros((NAVIGATION + count,) * 2, others.dtype)
    inputs = (transition.navigation, others, corrections)
    (_, total), _ = jax.lax.scan(one, (start, empty), inputs)
    return total


def _eliminated(gramian: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information on the calibration states with the navigation states estimated beside them."""
    n = NAVIGATION
    # In the unit of the prior, so that rad, m/s and m do not differ by orders of magnitude.
    scale = np.sqrt(np.diagonal(prior))
    inside = gramian[:n, :n] * np.outer(scale, scale)
    inside += np.linalg.inv(prior / np.outer(scale, scale))
    across = gramian[n:, :n] * scale
    return gramian[n:, n:] - across @ np.linalg.solve(inside, across.T)


def _prior_directions(correlation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns E with E Eᵀ the prior covariance of the states, and which of them vary at all."""
    values, vectors = np.linalg.eigh(correlation)
    kept = values > 1e3 * len(values) * np.finfo(float).eps * values[-1]
    return vectors[:, kept] * np.sqrt(values[kept]), np.diagonal(correlation) > 0.0
