"""The coefficients of both triads' curves as one vector: names, units, covariance, blocks, draws.

The accelerometers' come first; each triad's are row-major, (basis function, parameter).
"""

import math
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from jaxtyping import Float

from .._jax import Array, jax, jnp
from .._records import field, Module
from .._typing import AnyArray
from ..numerics.linear_algebra import symmetric_eigen
from .triad import TriadCalibration, unit_of


Triads = tuple[TriadCalibration, ...]


class Block(Module):
    """Some of a calibration's coefficients, with their covariance."""

    # Places among all coefficients; `indices` is the same as an array.
    rows: tuple[int, ...] = field(static=True)
    names: tuple[str, ...] = field(static=True)  # such as accel.bias[0].c1
    units: tuple[str, ...] = field(static=True)  # SI
    mean: Float[AnyArray, "*batch coefficients"]  # values of the coefficients, in `units`
    # Of the coefficients, products of `units`.
    covariance: Float[AnyArray, "*batch coefficients coefficients"]

    @property
    def indices(self) -> np.ndarray:
        """Places among all coefficients, to index vectors and matrices with."""
        return np.asarray(self.rows, int)

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        shown = ", ".join(self.names)
        return f"Block(indices={list(self.rows)}, names=[{shown}], mean={np.shape(self.mean)})"


def names(triads: Triads) -> tuple[str, ...]:
    """`accel.bias[0]` where parameters are constant, else `accel.bias[0].c0`, `.c1` … by basis function."""
    return tuple(n + term for triad in triads for n, term in _terms(triad))


def units(triads: Triads) -> tuple[str, ...]:
    """SI unit of each coefficient; basis functions have none, so it is that of the parameter."""
    return tuple(unit_of(n) for triad in triads for n, _ in _terms(triad))


def _terms(triad: TriadCalibration) -> list[tuple[str, str]]:
    size = triad.curve.basis.size
    term = lambda k: f".c{k}" if size > 1 else ""
    return [(n, term(k)) for k in range(size) for n in triad.names]


def values(triads: Triads) -> Float[AnyArray, "*batch coefficients"]:
    """All coefficients in one vector."""
    flat = [_flat(t.curve.coefficients) for t in triads]
    return _library(*flat).concatenate(flat, axis=-1)


def _flat(coefficients: AnyArray) -> AnyArray:
    return coefficients.reshape(*coefficients.shape[:-2], -1)


def _library(*arrays: AnyArray) -> Any:
    """NumPy, in 64 bits whatever JAX is set to, where nothing is a JAX array."""
    return jnp if any(isinstance(x, jax.Array) for x in arrays) else np


def covariance(
    triads: Triads, cross: Float[AnyArray, "*batch rows columns"] | None
) -> Float[AnyArray, "*batch coefficients coefficients"]:
    """Joint covariance; zero between triads that were estimated apart (`cross` is `None`)."""
    own = [t.covariance for t in triads]
    if len(own) == 1:
        return own[0]
    first, second = own
    xp = _library(first, second, *(() if cross is None else (cross,)))
    shape = (*first.shape[:-1], second.shape[-1])
    across = xp.zeros(shape, first.dtype) if cross is None else xp.asarray(cross)
    top = xp.concatenate([xp.asarray(first), across], axis=-1)
    bottom = xp.concatenate([xp.swapaxes(across, -1, -2), xp.asarray(second)], axis=-1)
    return xp.concatenate([top, bottom], axis=-2)


# Choosing -----------------------------------------------------------------------------------------


def matching(triads: Triads, pattern: str | Sequence[str]) -> tuple[int, ...]:
    """Places of the coefficients that a pattern names, in order.

    A pattern is a name, `accel.matrix[1,0]`, or a family, `accel.bias`, `gyro.g_sensitivity`, `accel.scale` (the
    matrix' diagonal), `accel.misalignment` (the rest), with `*` for any text, and `.c0` … at its end for one basis
    function. Raises `ValueError` where it names none.
    """
    patterns = [pattern] if isinstance(pattern, str) else pattern
    if not isinstance(patterns, Sequence) or not all(isinstance(p, str) for p in patterns):
        raise ValueError(
            f"`calibration.block({pattern!r})`: a block is chosen by names, such as '*.bias' or 'accel.matrix[1,0]'."
        )
    terms = [x for triad in triads for x in _terms(triad)]
    found = set()
    for one in patterns:
        literal = one.replace("[", "[[]")
        mine = [
            k
            for k, (name, term) in enumerate(terms)
            if any(fnmatchcase(c + t, literal) for c in _called(name) for t in {"", term})
        ]
        if not mine:
            families = sorted({c for name, _ in terms for c in _called(name) if "[" not in c})
            functions = list(dict.fromkeys(t for _, t in terms if t))
            ends = f", each with {' '.join(functions)} over temperature" if functions else ""
            raise ValueError(
                f"`calibration.block({one!r})`: no coefficient is called that; there are {', '.join(families)}{ends}."
            )
        found.update(mine)
    return tuple(sorted(found))


def _called(name: str) -> tuple[str, ...]:
    """All names of a parameter: its own, its family's, and those by what a matrix' element means."""
    family, _, index = name.partition("[")
    called = (name, family)
    if not family.endswith(".matrix"):
        return called
    row, column = index.rstrip("]").split(",")
    triad = family.partition(".")[0]
    if row == column:
        return (*called, f"{triad}.scale", f"{triad}.scale[{row}]")
    return (*called, f"{triad}.misalignment", f"{triad}.misalignment[{row},{column}]")


def replaced(
    triads: Triads,
    rows: Sequence[int],
    new: Float[AnyArray, "*batch coefficients"],
    given: str = "calibration.with_values(block, values)",
) -> tuple[AnyArray, ...]:
    """Each triad's coefficients with some replaced; leading axes of the values become leading axes of all.

    Raises `ValueError` where the last axis has another length than the block.
    """
    if jnp.ndim(new) == 0 or jnp.shape(new)[-1] != len(rows):
        raise ValueError(
            f"`{given}`: values have shape {jnp.shape(new)}, but the block has {len(rows)} coefficients."
        )
    flat = values(triads)
    xp = _library(flat, new)
    flat, new = xp.asarray(flat), xp.asarray(new)
    lead = np.broadcast_shapes(flat.shape[:-1], new.shape[:-1])
    whole = xp.broadcast_to(flat, (*lead, flat.shape[-1]))
    whole = _put(whole, np.asarray(rows, int), new.astype(whole.dtype))
    parts, start = [], 0
    for triad in triads:
        shape = triad.curve.coefficients.shape[-2:]
        stop = start + shape[0] * shape[1]
        parts.append(whole[..., start:stop].reshape(*lead, *shape))
        start = stop
    return tuple(parts)


def regression(
    spread: Float[AnyArray, "*batch n n"], rows: Sequence[int]
) -> tuple[Float[AnyArray, "*batch n k"], Float[AnyArray, "*batch n n"]]:
    """How a Gaussian's components follow those at `rows`, and the covariance that is left where these are known:

    L = C_·b C_bb⁻¹,  the identity at `rows`;    C − L C_b·,  zero there.
    """
    xp = _library(spread)
    spread, known = xp.asarray(spread), np.asarray(rows, int)
    count = spread.shape[-1]
    if not len(known):
        return xp.zeros((*spread.shape[:-1], 0), spread.dtype), spread
    across = spread[..., :, known]
    inside = across[..., known, :]
    # A correlation, whose directions without variance are left out: coefficients may be held exactly.
    scale = _positive(xp.sqrt(xp.diagonal(inside, axis1=-2, axis2=-1)))
    whole = scale[..., :, None] * scale[..., None, :]
    cut = xp.asarray(1e3 * len(known) * xp.finfo(spread.dtype).eps, spread.dtype)
    values, vectors = symmetric_eigen(inside / whole)
    kept = xp.abs(values) > cut * xp.max(xp.abs(values), axis=-1, keepdims=True)
    over = xp.where(kept, 1.0 / xp.where(kept, values, 1.0), 0.0)
    inverse = (vectors * over[..., None, :]) @ xp.swapaxes(vectors, -1, -2) / whole
    # What is known is so exactly, where rounding would leave some.
    free = np.ones(count)
    free[known] = 0.0
    free = xp.asarray(free, spread.dtype)
    itself = xp.asarray(np.eye(count)[:, known], spread.dtype)
    gain = itself + free[:, None] * (across @ inverse)
    left = spread - gain @ xp.swapaxes(across, -1, -2)
    return gain, 0.5 * (left + xp.swapaxes(left, -1, -2)) * (free[:, None] * free[None, :])


def conditional(
    mean: Float[AnyArray, "*batch n"],
    spread: Float[AnyArray, "*batch n n"],
    rows: Sequence[int],
    given: Float[AnyArray, "*given k"],
) -> tuple[Float[AnyArray, "*both n"], Float[AnyArray, "*both n n"]]:
    """Mean and covariance of a Gaussian whose components `rows` are known to be `given`."""
    xp = _library(mean, spread, given)
    gain, left = regression(spread, rows)
    known, lead = np.asarray(rows, int), np.broadcast_shapes(mean.shape[:-1], given.shape[:-1])
    wide = lambda x, axes: xp.broadcast_to(x, (*lead, *x.shape[-axes:]))
    mean, left = wide(xp.asarray(mean), 1), wide(left, 2)
    given = wide(xp.asarray(given, mean.dtype), 1)
    change = xp.asarray(gain, mean.dtype) @ (given - mean[..., known])[..., None]
    return _put(mean + change[..., 0], known, given), left


def _put(whole: AnyArray, place: np.ndarray, new: AnyArray) -> AnyArray:
    """A copy of vectors with other numbers at some places."""
    if isinstance(whole, np.ndarray):
        copy = whole.copy()
        copy[..., place] = new
        return copy
    return whole.at[..., place].set(new)


# The Gaussian -------------------------------------------------------------------------------------


def draws(
    key: Array, mean: Float[AnyArray, " n"], spread: Float[AnyArray, "n n"], count: int
) -> Float[Array, "draws n"]:
    """Draws of the coefficients, in default precision of JAX."""
    scale, vectors, roots, _ = _principal(spread)
    normal = jax.random.normal(key, (count, len(scale)))
    turn = jnp.asarray(vectors * roots[None, :]).astype(normal.dtype)
    offset = jnp.asarray(scale).astype(normal.dtype)[None, :] * (normal @ turn.T)
    return jnp.asarray(mean).astype(normal.dtype)[None, :] + offset


def log_density(
    point: Float[AnyArray, " n"], mean: Float[AnyArray, " n"], spread: Float[AnyArray, "n n"]
) -> Float[Array, ""]:
    """Logarithm of the Gaussian's density at a point, on its support; −∞ off it.

    The density is that of the directions that have variance. Along the others a point may be off the mean by rounding
    only: its own, and ten times what rounding of the covariance hides.
    """
    if jnp.shape(point) != jnp.shape(mean):
        raise ValueError(
            f"`calibration.log_density(values)`: values have shape {jnp.shape(point)}, but the calibration has "
            f"{jnp.shape(mean)[0]} coefficients."
        )
    scale, vectors, roots, kept = _principal(spread)
    x = jnp.asarray(point)
    cast = lambda y: jnp.asarray(y).astype(x.dtype)
    off = jnp.where(cast(scale) > 0.0, (x - cast(mean)) / cast(_positive(scale)), jnp.zeros_like(x))
    along = cast(vectors).T @ off
    whitened = jnp.where(kept, along / cast(_positive(roots)), jnp.zeros_like(x))
    xp = _library(scale, roots)
    sizes = xp.sum(xp.log(_positive(scale))) + xp.sum(xp.where(kept, xp.log(_positive(roots)), 0.0))
    constant = cast(sizes) + 0.5 * math.log(2.0 * math.pi) * cast(xp.sum(kept))
    density = -0.5 * jnp.sum(jnp.square(whitened)) - constant
    # Rounding of a point: of a coefficient held exactly, and of each in standard deviations along a principal axis.
    rounding = 4.0 * float(jnp.finfo(x.dtype).eps) * (jnp.abs(cast(mean)) + jnp.abs(x))
    held = jnp.all((cast(scale) > 0.0) | (jnp.abs(x - cast(mean)) <= rounding))
    in_sigmas = jnp.where(cast(scale) > 0.0, rounding / cast(_positive(scale)), jnp.zeros_like(x))
    least = 10.0 * math.sqrt(len(kept) * float(xp.finfo(xp.asarray(spread).dtype).eps))
    allowed = least + jnp.abs(cast(vectors)).T @ in_sigmas
    on_support = held & jnp.all(jnp.asarray(kept) | (jnp.abs(along) <= allowed))
    return jnp.where(on_support, density, -jnp.inf)


def _positive(x: AnyArray) -> AnyArray:
    """The numbers with ones for zeros, to divide by."""
    xp = _library(x)
    return xp.where(x > 0.0, x, xp.ones_like(x))


def _principal(spread: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Standard deviations, principal axes of the correlation, roots of its eigenvalues, and which are not zero.

    Coefficients differ in size by their units, so that the correlation is factorised, not the covariance.
    """
    xp = _library(spread)
    spread = xp.asarray(spread)
    scale = xp.sqrt(xp.diagonal(spread))
    safe = _positive(scale)
    eigenvalues, vectors = symmetric_eigen(spread / (safe[:, None] * safe[None, :]))
    least = len(scale) * xp.finfo(spread.dtype).eps * xp.max(eigenvalues)
    kept = eigenvalues > least
    return scale, vectors, xp.sqrt(xp.where(kept, eigenvalues, xp.zeros_like(eigenvalues))), kept
