"""The noise of a type of device, learned from several of its units, for the diagnosis of another one.

A diagnosis learns the noise from the recording that it judges. Where few dwells or few hours tell it, an effect
of ten standard deviations under the true noise can pass for a little more noise. Units of one type on one
station have about the same noise, so that several of them tell it:

$$\\log v_u \\sim N(\\mu, \\mathrm{diag}(s^2)), \\qquad p(\\mu \\mid units) \\propto p_0(\\mu) \\prod_u L_u(\\mu),$$

with the restricted likelihoods $L_u$ of the units' log variances $v_u$. The posterior of $\\mu$ is summed up by
its mean and covariance over weighted draws, since a variance that no unit shows is bounded from above alone.
The scatter $s$ between units is estimated from the units' scores at the joint maximum, for each variance alone,
and never taken for less than a fifth.

**Reference:** Gelman et al., *Bayesian Data Analysis*, 3rd ed., ch. 5 (populations) and 10.4 (importance sampling).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ...data.recording import Rig
from ...numerics.student_t import HeavyTails
from .observation_series import BOUNDS, STARTS, System
from .reml import restricted
from .restricted_likelihood import RestrictedLikelihood
from .state_space import Known, NUM_VARIANCES, WALK


DRAWS = 300  # a fifth to a half of them count
TOLD = 0.3  # standard deviation of a log variance up to which its posterior is like a normal one
MOST_TRIES = 200  # draws for each that is possible
VAGUE = 4.0  # standard deviation of a log variance before any unit was seen
LEAST_SCATTER = 0.2  # between units, of a log variance
SHOWN = 0.25  # information on a log variance from which a unit's own value counts
STEP = 0.05  # of the differences that give second derivatives


class ChainNoise(eqx.Module):
    """What several units tell of the log variances of one chain, in SI units squared."""

    label: str = eqx.field(static=True)
    mean: Float[np.ndarray, "7"]
    covariance: Float[np.ndarray, "7 7"]
    scatter: Float[np.ndarray, "7"]  # between units, standard deviation of each log variance

    def relative(self, scale: Float[np.ndarray, "7"]) -> Known:
        """The same relative to a chain's scale."""
        return Known(self.mean - np.log(scale), np.linalg.inv(self.covariance))


class TypeNoise(eqx.Module):
    """The noise of a type of device, chain by chain, and the units that told it."""

    chains: tuple[ChainNoise, ...]
    rig: Rig  # of the station; its promises are the unit of two variances
    units: tuple[str, ...] = eqx.field(static=True)
    left_out: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())  # name and why
    diagnosed: bool | None = eqx.field(
        static=True, default=None
    )  # first, each unit; None: not said

    def origin(self) -> str:
        """Where the noise comes from, in a sentence."""
        how = {
            True: "each found consistent first",
            False: "taken as consistent without a diagnosis",
            None: "it is not said whether they were diagnosed first",
        }
        return (
            f"Known beforehand from {len(self.units)} units of the type ({', '.join(self.units)}), "
            f"{how[self.diagnosed]}."
        )

    def require(self, rig: Rig) -> None:
        """Raises `ValueError` for a station that promises something else."""
        if of_variances(rig) != of_variances(self.rig):
            raise ValueError(
                f"the noise was learned where [rig] says {_promised(self.rig)}, but this campaign's says "
                f"{_promised(rig)}; learn the noise on the station that is used."
            )

    def inform(self, system: System) -> System:
        """The system with what is known of its variances. Raises `ValueError` for rows that are not among the known."""
        by_label = {c.label: c for c in self.chains}
        labels = chain_labels(system)
        lacking = [x for x in labels if x not in by_label]
        if lacking:
            raise ValueError(
                f"the known noise is of {', '.join(by_label)}, but this campaign's rows are of "
                f"{', '.join(labels)}; learn the noise from campaigns with the same sensors and estimators."
            )
        known = tuple(by_label[x].relative(s) for x, s in zip(labels, system.scales))
        return eqx.tree_at(lambda s: s.known, system, known)


def of_variances(rig: Rig) -> tuple[float | None, float | None, float | None]:
    """What a rig states that is a variance of rows: position, rate and temperature."""
    return rig.position_uncertainty, rig.rate_uncertainty, rig.temperature_uncertainty


def _promised(rig: Rig) -> str:
    said = (
        ("position_uncertainty", rig.position_uncertainty, 180.0 * 3600.0 / np.pi, "arcsec"),
        ("rate_uncertainty", rig.rate_uncertainty, 1e6, "ppm"),
        ("temperature_uncertainty", rig.temperature_uncertainty, 1.0, "°C"),
    )
    words = [
        f"{name} = {value * f:.4g} {unit}" for name, value, f, unit in said if value is not None
    ]
    return ", ".join(words) or "nothing"


def chain_labels(system: System) -> list[str]:
    """Channel of each chain; the triad where one chain holds the magnitude."""
    triad, num = system.base.form.triad, len(system.chains)
    return [f"{triad}_{axis}" for axis in "xyz"] if num == 3 else [f"|{triad}|"]


@dataclass(frozen=True, eq=False)
class _Units:
    """One chain of every unit."""

    systems: tuple[System, ...]
    chain: int
    center: Float[np.ndarray, "7"]  # of the vague prior
    least: Float[np.ndarray, "7"]  # log variances that are possible
    most: Float[np.ndarray, "7"]

    @cached_property
    def rows(self) -> list[RestrictedLikelihood]:
        """The likelihood of each unit's own rows, with nothing known beforehand."""
        bare = [replace(s, known=tuple(Known.nothing() for _ in s.known)) for s in self.systems]
        return [restricted(s, self.chain, ()) for s in bare]

    def one(self, unit: int, value: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the log likelihood of one unit, and its gradient, at absolute log variances."""
        theta = value - np.log(self.systems[unit].scales[self.chain])
        made, slope = self.rows[unit].value_and_slope(theta)
        # The price of a walk is a prior of its own; it is paid once, by the unit that is judged.
        price = 0.5 * WALK * np.logaddexp(0.0, theta[2] + 3.0)
        slope[2] -= 0.5 * WALK / (1.0 + np.exp(-theta[2] - 3.0))
        return made - price, slope

    def all(self, value: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the log posterior of a common value, and its gradient."""
        parts = [self.one(u, value) for u in range(len(self.systems))]
        off = (value - self.center) / VAGUE
        total = sum(p for p, _ in parts) + 0.5 * off @ off
        if not np.isfinite(total):
            return 1e12, np.zeros(NUM_VARIANCES)
        return float(total), np.sum([s for _, s in parts], axis=0) + off / VAGUE

    def draws(self, values: np.ndarray) -> np.ndarray:
        """`all` without its gradient at many values."""
        total = 0.5 * (((values - self.center) / VAGUE) ** 2).sum(axis=1)
        for system, rows in zip(self.systems, self.rows):
            theta = values - np.log(system.scales[self.chain])
            made = np.array([rows.value(t) for t in theta])
            total = total + made - 0.5 * WALK * np.logaddexp(0.0, theta[:, 2] + 3.0)
        return np.where(np.isfinite(total), total, np.inf)


def learn_chain(systems: Sequence[System], chain: int, label: str) -> ChainNoise:
    """The log variances of one chain from several units' systems."""
    from scipy.optimize import minimize  # slow to import, and a diagnosis does without

    scales = np.log([s.scales[chain] for s in systems]).mean(axis=0)
    low, high = np.transpose(BOUNDS) + scales
    units = _Units(tuple(systems), chain, scales + np.mean(STARTS, axis=0), low, high)
    modes = []
    for start in STARTS:
        found = minimize(
            units.all, start + scales, jac=True, method="L-BFGS-B",
            bounds=np.stack([low, high], axis=1), options={"maxiter": 60},
        )  # fmt: skip
        modes.append((float(found.fun), found.x))
    best = min(modes, key=lambda m: m[0])
    near = [m for m in modes if m[0] < best[0] + 6.0 and (m is best or _apart(m[1], best[1]))]
    informations = [[_information(units, u, x) for u in range(len(systems))] for _, x in near]
    mean, covariance = _moments(
        units, [x for _, x in near], [np.sum(i, axis=0) for i in informations]
    )
    scatter = _scatter(units, best[1], informations[near.index(best)])
    covariance = covariance + np.diag(scatter**2) * (1.0 + 1.0 / len(systems))
    return ChainNoise(label, mean, covariance, scatter)


def _apart(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(one - other).max() > 0.5)


def _information(units: _Units, unit: int, at: np.ndarray) -> np.ndarray:
    """Second derivatives of minus one unit's log likelihood, made positive."""
    rows = []
    for k in range(NUM_VARIANCES):
        step = STEP * np.eye(NUM_VARIANCES)[k]
        rows.append((units.one(unit, at + step)[1] - units.one(unit, at - step)[1]) / (2 * STEP))
    value, vector = np.linalg.eigh(0.5 * (np.array(rows) + np.array(rows).T))
    return (vector * np.maximum(value, 0.0)) @ vector.T


def _moments(
    units: _Units, modes: Sequence[np.ndarray], informations: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the posterior by importance sampling around its modes."""
    vague = np.eye(NUM_VARIANCES) / VAGUE**2
    rng = np.random.default_rng(0)
    shapes = [
        HeavyTails.around(mode, spread)
        for mode, information in zip(modes, informations)
        for spread in _spreads(np.linalg.inv(information + vague))
    ]
    parts = [_inside(units, shape, DRAWS // len(shapes), rng) for shape in shapes]
    values = np.concatenate([v for v, _ in parts])
    density = np.logaddexp.reduce(
        [shape.log_density(values) - np.log(share) for shape, (_, share) in zip(shapes, parts)]
    )
    log_weight = -units.draws(values) - density
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ values
    off = values - mean
    return mean, (weight[:, None] * off).T @ off


def _spreads(covariance: np.ndarray) -> list[np.ndarray]:
    """The covariance at a mode, and as wide as before any unit was seen in each variance that it tells moderately.

    Such a variance may as well be next to nothing: its likelihood is flat far below the mode.
    """
    spread = np.sqrt(np.diag(covariance))
    wider = np.flatnonzero((spread > TOLD) & (spread < 0.8 * VAGUE))
    return [covariance, *(covariance + np.diag(VAGUE**2 * np.eye(NUM_VARIANCES)[k]) for k in wider)]


def _inside(
    units: _Units, shape: HeavyTails, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Draws that are possible, and the share of draws that were."""
    kept, drawn = [], 0
    while sum(map(len, kept)) < count and drawn < MOST_TRIES * count:
        values = shape.draw(4 * count, rng)
        kept.append(values[((values >= units.least) & (values <= units.most)).all(axis=1)])
        drawn += len(values)
    found = np.concatenate([*kept, np.clip(shape.center, units.least, units.most)[None]])
    return found[:count], len(found) / (drawn + 1)


def _scatter(
    units: _Units, at: np.ndarray, informations: Sequence[np.ndarray]
) -> Float[np.ndarray, "7"]:
    """Standard deviation of the units' log variances around the common ones, each by the units' scores.

    Under scatter $s$ a unit's score $g$ has variance $H + s^2 H^2$, so that $g^2 / H$ is $1 + s^2 H$ in the mean
    where the unit shows the variance at all; the common value takes up one unit's part.
    """
    scores = np.array([units.one(u, at)[1] for u in range(len(informations))])
    square = np.array([np.diag(i) for i in informations])
    shown = square > SHOWN
    excess = np.where(shown, scores**2 / np.where(shown, square, 1.0) - 1.0, 0.0).sum(axis=0)
    share = (len(informations) - 1) / len(informations)
    room = share * np.where(shown, square, 0.0).sum(axis=0)
    found = np.where(room > 0.0, excess / np.where(room > 0.0, room, 1.0), 0.0)
    return np.sqrt(np.maximum(found, LEAST_SCATTER**2))
