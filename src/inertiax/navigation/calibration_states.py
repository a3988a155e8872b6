"""Which of a calibration's coefficients a filter estimates, with their covariance as prior.

A triad's output is linear in its parameters: row i of a' = a + Σ_c θ_ic(T) r_c with the regressors
r = (1, a) of accelerometers and (1, ω, a/g) of gyros, and θ_ic(T) = Σ_a φ_a(T) C_aic. So one state, a coefficient
C_aic, is a place (a, i, c). States are in units of their prior standard deviation: single precision suffices, and a
covariance that determines a coefficient exactly is no special case.
"""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..calibration.calibration import Calibration, TriadCalibration
from ..physics.temperature import AbstractBasis, Constant, interpolate


REGRESSORS = {"accel": 4, "gyro": 7}
_NAME = re.compile(r"(?:accel|gyro)\.(bias|matrix|g_sensitivity)\[([0-2])(?:,([0-2]))?\]")
_FIRST = {"bias": 0, "matrix": 1, "g_sensitivity": 4}


def place_of(name: str) -> tuple[int, int]:
    """Row and regressor of a parameter such as `gyro.matrix[1,0]`."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise ValueError(
            f"{name!r} is not a parameter such as 'accel.bias[0]' or 'gyro.matrix[1,0]'."
        )
    kind, row, column = match.groups()
    return int(row), _FIRST[kind] + int(column or 0)


def _labels(name: str) -> tuple[str, ...]:
    """What a pattern may call a parameter: its name, its family, and `scale` or `misalignment` in a matrix."""
    family = name.split("[")[0]
    if not family.endswith(".matrix"):
        return name, family
    row, regressor = place_of(name)
    kind = "scale" if regressor == row + 1 else "misalignment"
    return name, family, f"{name.split('.')[0]}.{kind}"


def selects(pattern: str, name: str) -> bool:
    """Whether a pattern such as `*.bias`, `accel.scale`, `gyro.matrix[0,0]` or `*` names a parameter."""
    return pattern == name or any(fnmatchcase(label, pattern) for label in _labels(name))


class TriadStates(eqx.Module):
    """One triad's curve as an array, and the places of its estimated coefficients."""

    basis: AbstractBasis
    coefficients: Float[AnyArray, "size 3 regressors"]
    # Functions of temperature along which states move: the basis' own, or only the constant one.
    directions: Float[AnyArray, "size columns"]
    places: tuple[tuple[int, int, int], ...] = eqx.field(static=True)  # (column, row, regressor)

    def moved(self, values: Float[AnyArray, " states"]) -> Float[Array, "size 3 regressors"]:
        """The curve's coefficients with the states' values (SI) added."""
        base = jnp.asarray(self.coefficients)
        if not self.places:
            return base
        a, i, c = np.array(self.places).T
        shift = jnp.zeros((self.directions.shape[1], *base.shape[1:]), base.dtype)
        shift = shift.at[a, i, c].add(jnp.asarray(values))
        return base + jnp.einsum("sc,cij->sij", jnp.asarray(self.directions), shift)

    def gather(
        self, responses: Float[Array, "rows 3 regressors size"]
    ) -> Float[Array, "rows states"]:
        """Of the response to every coefficient, that to the estimated ones."""
        if not self.places:
            return jnp.zeros((responses.shape[0], 0), responses.dtype)
        a, i, c = np.array(self.places).T
        along = responses @ jnp.asarray(self.directions)
        return along[:, i, c, a]


class CalibrationStates(eqx.Module):
    """The estimated coefficients of both triads, accelerometers first."""

    accel: TriadStates
    gyro: TriadStates
    scale: Float[AnyArray, " states"]  # SI per state: prior standard deviations
    correlation: Float[AnyArray, "states states"]  # prior covariance of the states
    names: tuple[str, ...] = eqx.field(static=True)  # parameter of each state
    # Of the states among the calibration's coefficients
    rows: tuple[int, ...] = eqx.field(static=True)
    functions: tuple[int, ...] = eqx.field(static=True)  # its function of temperature
    thermal: bool = eqx.field(static=True)

    def split(self, states: Float[AnyArray, " states"]) -> tuple[Array, Array]:
        """States as coefficients in SI: of the accelerometers and of the gyros."""
        values = jnp.asarray(states) * jnp.asarray(self.scale)
        count = len(self.accel.places)
        return values[:count], values[count:]

    def moved(self, states: Float[AnyArray, " states"]) -> tuple[Array, Array]:
        """Both triads' curve coefficients at given states."""
        accel, gyro = self.split(states)
        return self.accel.moved(accel), self.gyro.moved(gyro)


def calibration_states(
    calibration: Calibration, patterns: str | Sequence[str], *, thermal: bool = True
) -> CalibrationStates:
    """The states that patterns choose of a calibration, with its covariance as their prior.

    **Arguments:** a pattern is a parameter (`accel.bias[0]`), a family (`accel.bias`, `gyro.matrix`, `*.scale`,
    `*.misalignment`, `gyro.g_sensitivity`) or `*`; an empty sequence estimates none. With `thermal=False` each chosen
    parameter is one constant over temperature, as in filters of 15 or 21 states; its prior is the calibration's
    covariance averaged over the basis' nodes.

    Raises `ValueError` where a pattern chooses nothing or the calibration holds effects, which depend on
    what went before and are no part of the filter's model.
    """
    patterns = (patterns,) if isinstance(patterns, str) else tuple(patterns)
    if calibration.effects:
        names = ", ".join(e.name for e in calibration.effects)
        raise ValueError(
            f"`Filter(calibration=...)`: its effects ({names}) are not modelled here; compensate the outputs for "
            f"them first and give the calibration without."
        )
    _check_patterns(patterns, calibration)
    triads = [_triad(calibration, name, patterns, thermal) for name in ("accel", "gyro")]
    first = 0 if calibration.accel is None else jnp.size(calibration.accel.curve.coefficients)
    rows = (*triads[0][3], *(first + r for r in triads[1][3])) if thermal else ()
    if thermal and rows:
        chosen = np.array(rows)
        covariance = jnp.asarray(calibration.covariance)[chosen[:, None], chosen[None, :]]
    else:
        covariance = _apart([t[1] for t in triads])
    scale = jnp.sqrt(jnp.diagonal(covariance))
    # A coefficient of no variance stays where it is: its scale is 0, whatever its state does.
    safe = jnp.where(scale > 0.0, scale, jnp.ones_like(scale))
    correlation = covariance / (safe[:, None] * safe[None, :])
    return CalibrationStates(
        triads[0][0], triads[1][0], scale, correlation,
        tuple(n for t in triads for n in t[2]), rows,
        tuple(p[0] for t in triads for p in t[0].places), thermal,
    )  # fmt: skip


def _check_patterns(patterns: Sequence[str], calibration: Calibration) -> None:
    triads = (calibration.accel, calibration.gyro)
    names = [n for t in triads if t is not None for n in t.names]
    for pattern in patterns:
        if not any(selects(pattern, n) for n in names):
            known = ", ".join(sorted({label for n in names for label in _labels(n)[1:]}))
            raise ValueError(
                f"`Filter(states={pattern!r})` chooses none of the calibration's parameters; "
                f"their families are {known}."
            )


def _apart(blocks: list[Array]) -> Float[Array, "states states"]:
    first, second = blocks
    corner = jnp.zeros((first.shape[0], second.shape[0]), first.dtype)
    return jnp.block([[first, corner], [corner.T, second]])


def _triad(
    calibration: Calibration, name: str, patterns: Sequence[str], thermal: bool
) -> tuple[TriadStates, Float[Array, "states states"], tuple[str, ...], tuple[int, ...]]:
    """A triad's states, their prior covariance in SI, the parameter of each, and its row among the coefficients."""
    triad: TriadCalibration | None = getattr(calibration, name)
    dtype = jnp.asarray(calibration.gravity).dtype
    if triad is None:
        empty = TriadStates(
            Constant(), jnp.zeros((1, 3, REGRESSORS[name]), dtype), jnp.ones((1, 1), dtype), ()
        )
        return empty, jnp.zeros((0, 0), dtype), (), ()
    basis, values = triad.curve.basis, jnp.asarray(triad.curve.coefficients)
    rows, regressors = np.array([place_of(n) for n in triad.names]).T
    dense = jnp.zeros((basis.size, 3, REGRESSORS[name]), values.dtype)
    dense = dense.at[:, rows, regressors].set(values)
    chosen = np.array(
        [k for k, n in enumerate(triad.names) if any(selects(p, n) for p in patterns)], int
    )
    blocks = jnp.asarray(triad.covariance, values.dtype).reshape(
        basis.size, len(rows), basis.size, len(rows)
    )
    blocks = blocks[:, chosen][:, :, :, chosen]
    if thermal:
        directions, count = jnp.eye(basis.size, dtype=values.dtype), basis.size
        covariance = blocks.reshape(count * len(chosen), count * len(chosen))
    else:
        directions, count = interpolate(basis, jnp.ones((basis.size, 1), values.dtype)), 1
        nodes = jnp.stack([basis(jnp.asarray(t, values.dtype)) for t in basis.nodes])
        covariance = jnp.einsum("ta,aibj,tb->ij", nodes, blocks, nodes) / len(basis.nodes)
    places = tuple((a, int(rows[k]), int(regressors[k])) for a in range(count) for k in chosen)
    names = tuple(triad.names[k] for _ in range(count) for k in chosen)
    rows_of = tuple(a * len(triad.names) + int(k) for a in range(count) for k in chosen)
    return TriadStates(basis, dense, directions, places), covariance, names, rows_of
