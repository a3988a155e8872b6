"""What lagging elements take from the calibration beside them: they were at other temperatures than the probe's.

The outputs without a lag are compared with the model at the probe's temperature, and what was taken away is made of
the model's own parameters, which are known as the elements' temperatures tell them: a range that the probe reached and
the elements did not is extrapolated, whatever was taken away there. With the columns X of the parameters at the
elements' temperatures (s) and at the probe's (p), the white noise as weights W, and G = (XᵀWX)⁻¹XᵀW, the calibration
is to first order

    θ = M y,    M = G_s + G_p (E − X_s G_s),

and of white noise it has the covariance N_s + N_p − K N_s Kᵀ, N = (XᵀWX)⁻¹, K = G_p X_s, where the fit says N_p.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ...numerics.linear_algebra import scaled_inverse
from ..candidates.signatures import Term
from ..element_temperature import bilinear
from ..problem import Prepared
from .separable import at_element


def seen_by_elements(prepared: Prepared, terms: Sequence[Term]) -> Prepared:
    """The triad with the parameters' columns at the temperatures that these terms say of its elements."""
    mine = [t for t in terms if bilinear(t)]
    if not mine:
        return prepared
    # The model is linear: its columns are those of any parameters.
    values = prepared.system.base.coefficients
    return replace(prepared, system=at_element(prepared, mine, (), values))


def extrapolated(
    prepared: Prepared,
    terms: Sequence[Term],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    count: int,
) -> Float[np.ndarray, "unknowns unknowns"]:
    """What is added to the `covariance` of `count` parameters, whose coefficients are row-major (size, parameters)."""
    size = len(covariance) // count
    seen = seen_by_elements(prepared, terms)
    if seen is prepared or size == 1:
        return np.zeros_like(covariance)
    told, taken, carried = _normal(seen), _normal(prepared), _normal(prepared, seen)
    told, taken = scaled_inverse(told), scaled_inverse(taken)
    if not (np.isfinite(told).all() and np.isfinite(taken).all()):
        return np.zeros_like(
            covariance
        )  # not determined: nothing is known of what is written either
    carried = taken @ carried
    more = told - carried @ told @ carried.T
    place, own = _places(len(told), count, size)
    taken, more = (_placed(x, place, own, size * count) for x in (taken, more))
    known = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    scale = known / np.sqrt(np.maximum(np.diagonal(taken), 1e-300))
    # In units of the fit's standard deviations, where biases and scale factors are alike.
    unit = np.where(known > 0.0, known, 1.0)
    more = scale[:, None] * more * scale / unit[:, None] / unit
    worth, direction = np.linalg.eigh(0.5 * (more + more.T))
    # Where elements tell more than the probe's temperatures promise, what is written stays.
    more = (direction * np.maximum(worth, 0.0)) @ direction.T
    return unit[:, None] * more * unit


def left_to_the_probe(seen: Prepared, term: Term) -> Term:
    """The term with what the parameters at the elements' temperatures leave of its columns: (E − X_s G_s) of them."""
    made = []
    for chain, columns in zip(term.chains, term.columns, strict=True):
        made.append(columns - seen.system.base.columns[chain] @ taken_up(seen, chain, columns))
    return replace(term, columns=tuple(made))


def taken_up(
    prepared: Prepared, chain: int, columns: Float[np.ndarray, "row coefficients"]
) -> Float[np.ndarray, "own coefficients"]:
    """The parameters of one chain that take most of these columns in: G of them, for the chain's own columns."""
    weight = 1.0 / np.sqrt(prepared.system.chains[chain].white)[:, None]
    x = prepared.system.base.columns[chain]
    norm = np.linalg.norm(x * weight, axis=0) + 1e-300
    return np.linalg.lstsq(x * weight / norm, columns * weight, rcond=1e-10)[0] / norm[:, None]


def _normal(first: Prepared, second: Prepared | None = None) -> Float[np.ndarray, "own own"]:
    """XᵀWX over all chains, or XᵀWX' with the columns of another one."""
    base = first.system.base
    other = base if second is None else second.system.base
    total = 1 + max(int(index.max()) for index in base.index)
    normal = np.zeros((total, total))
    for k, index in enumerate(base.index):
        white = first.system.chains[k].white[:, None]
        normal[np.ix_(index, index)] += base.columns[k].T @ (other.columns[k] / white)
    return normal


def _places(total: int, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the calibration has its coefficients, row-major (size, parameters), and which of the rows' they are."""
    number, power = np.divmod(np.arange(total), size)
    own = number < count  # lever arms are effects of the calibration, no parameters of the triad
    return power[own] * count + number[own], own


def _placed(
    values: Float[np.ndarray, "own own"], place: np.ndarray, own: np.ndarray, unknowns: int
) -> Float[np.ndarray, "unknowns unknowns"]:
    made = np.zeros((unknowns, unknowns))
    made[np.ix_(place, place)] = values[np.ix_(own, own)]
    return made
