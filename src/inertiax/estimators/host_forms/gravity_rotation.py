"""Gravity's rotation between rests: `GravityRotation`, by the turns of `carried_direction`.

Rates change by −(E + Θ)⁻¹ eᵢ x, where the parameter acts on output i through x: 1, a component of the compensated
rate, or of the force in g.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._jax import eqx, jax
from ...numerics.recent_answers import RecentAnswers
from ...physics.vectors import axes_across, cross_matrix, unit_vector
from ...reduction.dwells import Dwells
from ...reduction.motions import Motions
from .carried_direction import by_rates, Carried, carried
from .form import AbstractHostForm, LinearisedDwells, Vectors, whitening
from .layout import TriadErrors


# Fits of other weights begin, end and are judged at points where the turns are known: half of all.
_TILTS: RecentAnswers[tuple[np.ndarray, np.ndarray]] = RecentAnswers(16)
_SAMPLES_AT_ONCE = 100_000  # of motions; about 60 MB of rotations and their derivatives


class GravityRotationOnHost(AbstractHostForm):
    """Rates at rest, and the tilt of gravity after each motion."""

    def linearise(self, vectors: Vectors, dwells: Dwells) -> LinearisedDwells:
        errors = self.layout.unpack(vectors)
        force = self.force(dwells) / self.gravity
        rows = self._at_rest(errors, dwells)
        inputs = self.layout.inputs(np.zeros_like(force), force)
        tilt, slope = self._tilts(errors, dwells)
        still, moved, sigma = self._whitenings(dwells)
        jacobian = [-still[:, :, self.layout.output] * inputs[:, None, :], moved @ slope]
        return self.weighed(
            dwells,
            _whitened(still, rows, moved, tilt),
            np.concatenate(jacobian, axis=1),
            tilt,
            sigma,
        )

    def by_force(self, vectors: Vectors, dwells: Dwells) -> Float[np.ndarray, "dwell row 6"]:
        """What the specific force at a rest (three columns) and at the rest before its motion (three) do to the
        rows of `linearise`, per m/s².

        To first order in the tilt, the two angles change by E(u₂) (R δu₁ − δu₂) with E the unit vectors across u₂;
        the force during the motion, of which the D term reads 1e-3 rad/s a g, is left out.
        """
        errors = self.layout.unpack(vectors)
        still, moved, sigma = self._whitenings(dwells)
        count = dwells.num_dwells
        by_end, by_start = np.empty((count, 2, 3)), np.empty((count, 2, 3))
        tilt = np.empty((count, 2))
        for part in self._chunks(dwells):
            some = dwells[part]
            ends = self._ends(TriadErrors(*(x[part] for x in errors)), some)
            across = axes_across(unit_vector(np.asarray(some.accel)))
            tilt[part] = ends.tilt
            by_end[part] = -across @ _by_length(some.accel)
            by_start[part] = across @ ends.turned.turn @ _by_length(_motion(some).start_force)
        at_rest = still @ (-errors.g_sensitivity / self.gravity)
        rows = [
            np.concatenate([at_rest, np.zeros_like(at_rest)], axis=2),
            moved @ np.concatenate([by_end, by_start], axis=2),
        ]
        whole = _whitened(still, self._at_rest(errors, dwells), moved, tilt)
        return self.weighed(dwells, whole, np.concatenate(rows, axis=1), tilt, sigma).jacobian

    def _at_rest(self, errors: TriadErrors, dwells: Dwells) -> Float[np.ndarray, "dwell 3"]:
        """Mean rates that bias and D leave, rad/s."""
        force = self.force(dwells) / self.gravity
        left = np.asarray(dwells.gyro) - errors.bias
        return left - np.einsum("nij,nj->ni", errors.g_sensitivity, force)

    def _whitenings(
        self, dwells: Dwells
    ) -> tuple[
        Float[np.ndarray, "dwell 3 3"], Float[np.ndarray, "dwell 2 2"], Float[np.ndarray, "dwell 2"]
    ]:
        """L⁻¹ of the rates at rest and of the tilts, none where no motion led to a rest, and the tilts' own sigma."""
        still = whitening(np.asarray(dwells.gyro_covariance), 0.0)
        covariance = tilt_covariance(dwells)
        moved = whitening(covariance, self.scatter)
        moved = np.where(np.asarray(_motion(dwells).valid)[:, None, None], moved, 0.0)
        return still, moved, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    def response(
        self, vectors: Vectors, dwells: Dwells
    ) -> Iterator[Float[np.ndarray, "sample 2 3"]]:
        """What an addition to the outputs at each sample does to the two tilts, rad per rad/s, motion by motion.

        An addition e changes the compensated rate by (E + Θ)⁻¹ e.
        """
        errors, dwells = self.layout.unpack(vectors), jax.tree.map(np.asarray, dwells)
        for part in self._chunks(dwells):
            some = TriadErrors(*(x[part] for x in errors))
            ends = self._ends(some, dwells[part])
            refine = np.linalg.inv(np.eye(3) + some.matrix)
            yield from np.moveaxis(ends.by_rates(), 3, 1) @ refine[:, None]

    def start(self, dwells: Dwells) -> Float[np.ndarray, " parameter"]:
        mean = np.asarray(dwells.gyro)[np.asarray(dwells.valid)].mean(axis=0)
        return self.layout.pack(mean[None], np.zeros((1, 3, 3)), np.zeros((1, 3, 3)))[0]

    def compensate(self, vectors: Vectors, dwells: Dwells) -> Dwells:
        refined = super().compensate(vectors, dwells)
        rates = self._rates(self.layout.unpack(vectors), _motion(dwells))
        return eqx.tree_at(lambda d: d.motion.gyro, refined, rates)

    def _rates(self, errors: TriadErrors, motion: Motions) -> Float[np.ndarray, "dwell sample 3"]:
        """Compensated rates while the device moves, rad/s: equation (3)."""
        rate = np.asarray(motion.gyro) - errors.bias[:, None]
        if motion.force is not None:
            d = errors.g_sensitivity / self.gravity
            rate = rate - np.asarray(motion.force) @ np.swapaxes(d, 1, 2)
        return rate @ np.swapaxes(np.linalg.inv(np.eye(3) + errors.matrix), 1, 2)

    def _tilts(
        self, errors: TriadErrors, dwells: Dwells
    ) -> tuple[Float[np.ndarray, "dwell 2"], Float[np.ndarray, "dwell 2 parameter"]]:
        """The two angles of `gravity_rotation.tilt`, rad, and their Jacobian; few motions at a time."""
        motion = _motion(dwells)
        known = (motion.gyro, motion.force, motion.step, motion.start_force, dwells.accel)
        own = (np.array(self.layout.names), np.array(self.gravity))
        arrays = (*errors, *own, *(None if x is None else np.asarray(x) for x in known))
        return _TILTS(arrays, lambda: self._tilts_in_parts(errors, dwells))

    def _tilts_in_parts(
        self, errors: TriadErrors, dwells: Dwells
    ) -> tuple[Float[np.ndarray, "dwell 2"], Float[np.ndarray, "dwell 2 parameter"]]:
        parts = [
            self._tilts_of(TriadErrors(*(x[part] for x in errors)), dwells[part])
            for part in self._chunks(dwells)
        ]
        tilt, slope = zip(*parts, strict=True)
        return np.concatenate(tilt), np.concatenate(slope)

    def _chunks(self, dwells: Dwells) -> list[slice]:
        samples = np.shape(_motion(dwells).gyro)[1]
        chunk = max(_SAMPLES_AT_ONCE // samples, 1)
        return [slice(a, a + chunk) for a in range(0, dwells.num_dwells, chunk)]

    def _tilts_of(
        self, errors: TriadErrors, dwells: Dwells
    ) -> tuple[Float[np.ndarray, "dwell 2"], Float[np.ndarray, "dwell 2 parameter"]]:
        ends, motion = self._ends(errors, dwells), _motion(dwells)
        force = np.zeros_like(ends.rates) if motion.force is None else np.asarray(motion.force)
        inputs = self.layout.inputs(ends.rates, force / self.gravity)
        refine = np.linalg.inv(np.eye(3) + errors.matrix)
        flat = ends.by_rates().reshape(len(inputs), 6, -1)  # two tilts, three rates
        by_input = (flat @ inputs).reshape(len(inputs), 2, 3, -1)
        slope = -np.einsum("nkjp,njp->nkp", by_input, refine[:, :, self.layout.output])
        return ends.tilt, slope

    def _ends(self, errors: TriadErrors, dwells: Dwells) -> "_Ends":
        motion = _motion(dwells)
        rates = self._rates(errors, motion)
        turned = carried(rates, np.asarray(motion.step))
        start, end = unit_vector(motion.start_force), unit_vector(np.asarray(dwells.accel))
        predicted = np.einsum("nij,nj->ni", turned.turn, start)
        across, along = axes_across(end), 1.0 + np.einsum("ni,ni->n", end, predicted)
        tilt = 2.0 * np.einsum("nki,ni->nk", across, predicted) / along[:, None]
        moved = 2.0 * across - tilt[:, :, None] * end[:, None, :]
        by_turn = moved @ cross_matrix(predicted) / along[:, None, None]
        return _Ends(rates, tilt, by_turn, turned)


class _Ends(NamedTuple):
    """Motions with the direction of gravity at their ends."""

    rates: Float[np.ndarray, "dwell sample 3"]  # compensated, rad/s
    tilt: Float[np.ndarray, "dwell 2"]  # rad
    by_turn: Float[np.ndarray, "dwell 2 3"]  # its change by a small turn v at the end: u by u × v
    turned: Carried

    def by_rates(self) -> Float[np.ndarray, "dwell 2 3 sample"]:
        """The tilts' changes by each sample's compensated rate, s."""
        return by_rates(self.turned, self.by_turn)


def _whitened(
    still: Float[np.ndarray, "dwell 3 3"],
    at_rest: Float[np.ndarray, "dwell 3"],
    moved: Float[np.ndarray, "dwell 2 2"],
    tilt: Float[np.ndarray, "dwell 2"],
) -> Float[np.ndarray, "dwell 5"]:
    rows = [np.einsum("nij,nj->ni", w, r) for w, r in ((still, at_rest), (moved, tilt))]
    return np.concatenate(rows, axis=1)


def _by_length(force) -> Float[np.ndarray, "dwell 3 3"]:
    """∂u/∂f of u = f / |f|: (E − u uᵀ) / |f|."""
    force = np.asarray(force)
    unit, length = unit_vector(force), np.linalg.norm(force, axis=1)[:, None, None]
    return (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / length


def tilt_covariance(dwells: Dwells) -> Float[np.ndarray, "dwell 2 2"]:
    """Of the tilt, rad²: both directions (the first one's taken alike about all axes) and the integrated rate."""
    motion = _motion(dwells)
    end = _across_covariance(dwells.accel, dwells.accel_covariance)
    start = _across_covariance(motion.start_force, motion.start_covariance)
    alike = 0.5 * np.trace(start, axis1=1, axis2=2) + np.asarray(motion.noise)
    return end + alike[:, None, None] * np.eye(2)


def _across_covariance(force, covariance) -> Float[np.ndarray, "dwell 2 2"]:
    force = np.asarray(force)
    if covariance is None:
        return np.zeros((len(force), 2, 2))
    basis = axes_across(unit_vector(force))
    square = np.sum(np.square(force), axis=1)[:, None, None]
    return basis @ np.asarray(covariance) @ np.swapaxes(basis, 1, 2) / square


def _motion(dwells: Dwells) -> Motions:
    # Dwells for this estimator carry motions; `with_motions` says so where they cannot.
    assert dwells.motion is not None
    return dwells.motion
