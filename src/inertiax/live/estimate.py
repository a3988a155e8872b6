"""What the rests so far tell of the parameters, how far that is from the target, and where to turn next."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..calibration.quantities import coarse_rates, customary_unit, label
from ..data.recording import Campaign, Recording
from ..physics.directions import FEWEST_DIRECTIONS, hand_directions, num_directions
from .accel_rows import (
    accel_posterior,
    accel_rows,
    AccelModel,
    ByMagnitude,
    ByReference,
    compensated,
    PRIOR_MATRIX,
    RestMeans,
)
from .gyro_rows import integrated, NAMES as TURNED, planned_rows, Turn, turn_rows, Turned
from .next_position import (
    best_position,
    followed,
    MISALIGNED,
    MOST_AHEAD,
    NextPosition,
    Part,
    planned_limits,
    planned_shares,
    rests_needed,
)
from .posterior import Posterior, posterior_of, Rows
from .rest_ledger import Rest
from .target import CONFIDENCE, Target
from .warming import away_from_mean, followed_slopes, slope_std, with_slopes


# Degrees of freedom that the batch estimate is left with: its standard deviations do not widen for want of them, and
# Student's 95 % are 2.6 standard deviations with 5 and 4.3 with 2.
FEWEST_FREEDOM = 5
LINEAR = 2e-3  # change of the gyros' matrix over which a turn by radians is linear to 1e-5 rad (its square)
_MOST_STEPS = 6
TRIADS = {"accel": "accelerometers", "gyro": "gyros"}
PRIOR_RATE = 1.0  # rad/s, of a gyro's bias: wider than any
SOON = 1.0  # rests before a session may stop from which on it says how many are still needed
FORESEEN = 3.0  # times the target; beyond, the forecast was three times the truth (`benchmarks/live_hand.py`)


@dataclasses.dataclass(frozen=True, eq=False)
class Triad:
    """Names, posterior and limits of one triad's parameters."""

    names: tuple[str, ...]
    posterior: Posterior
    limits: Float[np.ndarray, " parameter"]  # ∞ where nothing is asked
    own_variance: float  # of a row, by the noise within a rest
    slopes: Float[np.ndarray, "3"] | None = None  # of the biases, per °C, where they follow it


@dataclasses.dataclass(frozen=True, eq=False)
class Estimate:
    """The answer so far."""

    triads: tuple[Triad, ...]
    model: AccelModel | None
    rests: int  # that are used
    lacking: str | None  # what the batch estimate lacks for all parameters, in words
    now: Float[np.ndarray, "3"] | None = None  # direction of the last rest, by the outputs

    @property
    def determined(self) -> bool:
        """Whether the batch estimate will have all parameters."""
        return self.lacking is None

    @property
    def ratio(self) -> float:
        """By how much the limits would have to be wider to hold together with 95 %; ∞ where nothing is known."""
        asked = [t for t in self.triads if np.isfinite(t.limits).any()]
        if not asked or not self.rests:
            return float("inf")
        return max(t.posterior.ratio(t.limits, CONFIDENCE ** (1.0 / len(asked))) for t in asked)

    @property
    def reached(self) -> bool:
        """Whether the target is reached and the batch estimate will say so, too."""
        return self.determined and self.ratio <= 1.0

    @property
    def worst(self) -> str | None:
        """The parameter that is furthest from its limit."""
        found = [
            (s / t, n) for x in self.triads for n, s, t in zip(x.names, x.posterior.std, x.limits)
        ]
        found = [(ratio, name) for ratio, name in found if ratio > 0.0]
        return max(found)[1] if found else None

    def parameters(self) -> dict[str, dict[str, object]]:
        """Value, standard deviation, unit and limit (`None`: nothing is asked) of each parameter.

        `label` is its name in words, `factor` takes it to `shown_unit`, that of `calibrate`'s table.
        """
        known = [
            (name, float(value), float(std), float(limit))
            for t in self.triads
            for name, value, std, limit in zip(t.names, t.posterior.mean, t.posterior.std, t.limits)
        ]
        coarse = coarse_rates(
            [value for name, value, _, _ in known if name.startswith("gyro.bias")]
        )
        made: dict[str, dict[str, object]] = {}
        for name, value, std, limit in known:
            factor, shown = customary_unit(name, coarse=coarse)
            made[name] = {
                "value": value,
                "std": std,
                "unit": unit_of(name),
                "limit": limit if np.isfinite(limit) else None,
                "label": f"{label(name)} of the {TRIADS[name.partition('.')[0]]}",
                "factor": factor,
                "shown_unit": shown,
            }
        return made

    def force(self, outputs: Float[np.ndarray, "rest 3"]) -> Float[np.ndarray, "rest 3"]:
        """Outputs of the accelerometers compensated, as far as they are known, m/s²."""
        if self.model is None:
            return outputs
        known = next(t.posterior.mean for t in self.triads if t.names == self.model.names)
        return compensated(known, outputs)

    def next_position(self) -> NextPosition | None:
        """Where to turn next: any position where directions of gravity tell nothing that is asked for; `None` where
        there are no accelerometers."""
        up = hand_directions()
        around = followed(up)
        parts, planned, ahead, lacking = [], [], MOST_AHEAD, 0.0
        for triad in self.triads:
            made = self._rows(triad, around.reshape(-1, 3))
            exact = self._rows(triad, up)
            if self.model is None or made is None or exact is None:
                continue
            variance = triad.own_variance + triad.posterior.scatter_variance
            rows = made.reshape(*around.shape[:2], *made.shape[1:])
            freedom = triad.posterior.freedom(triad.own_variance)
            parts.append(Part(triad.posterior.covariance, triad.limits, rows, variance, freedom))
            limits = planned_limits(triad.names, triad.limits, self.model.gravity)
            planned.append(Part(triad.posterior.covariance, limits, exact[:, None], variance))
            if self.model is not None and triad.names == self.model.names:
                # Before the first rest at which a session may stop nobody knows the noise, hence how many are needed.
                lacking = (len(triad.names) + FEWEST_FREEDOM) / exact.shape[1] - self.rests
                ahead = lacking if lacking >= 1.0 else MOST_AHEAD
        if not any(np.isfinite(p.limits).any() for p in parts):
            return None if self.now is None else _anywhere(self.now)
        share = planned_shares(planned, ahead)
        found = best_position(up, parts, share)
        return dataclasses.replace(found, further=self._further(parts, share, lacking))

    def _further(
        self, parts: list[Part], share: Float[np.ndarray, " candidate"], lacking: float
    ) -> int | None:
        """Rests that are still needed, `lacking` of them before a session may stop; `None` while the noise is mostly
        what its prior says."""
        ratio = self.ratio
        if lacking >= SOON or ratio > FORESEEN:
            return None
        needed = rests_needed(parts, share, ratio)
        return None if needed is None else max(needed, math.ceil(lacking), 1)

    def _rows(
        self, triad: Triad, up: Float[np.ndarray, "candidate 3"]
    ) -> Float[np.ndarray, "candidate row parameter"] | None:
        """Rows that a rest in each direction would add; `None` where directions tell nothing."""
        if self.model is None:
            return None
        if triad.names == self.model.names:
            return self.model.tried(triad.posterior.mean, up)
        if triad.names == TURNED and self.now is not None:
            return planned_rows(self.now, up)
        return None


def _anywhere(now: Float[np.ndarray, "3"]) -> NextPosition:
    """Another rest, as the device lies now or otherwise."""
    x, y, z = (float(c) for c in now)
    return NextPosition((x, y, z), "lay the device down anew, in any position", 0.0)


def unit_of(name: str) -> str:
    """Unit of a parameter in SI."""
    if ".matrix" in name:
        return "1"
    return "m/s^2" if name.startswith("accel") else "rad/s"


def estimate(
    rests: list[Rest],
    campaign: Campaign,
    target: Target,
    before: Estimate | None = None,
    turns: Sequence[Turn] = (),
) -> Estimate:
    """The estimate from accepted rests, with the model that `calibrate` would choose for these columns.

    **Arguments:** `before` is the estimate before the last rests, where the linearisation starts; `turns` are those
    between rests that follow each other. Raises `ValueError` for a target that these columns cannot tell.
    """
    model = accel_model(rests, campaign)
    triads, lacking = [], None
    away = away_from_mean([r.temperature for r in rests])
    if model is not None:
        start = None
        if before is not None and before.model is not None:
            start = next(t.posterior for t in before.triads if t.names == before.model.names)
        means = _rest_means(rests)
        found, slopes = accel_posterior(model, means, campaign.grade, start), None
        if away is not None:
            both = accel_posterior(model, means, campaign.grade, start, away)
            slopes = followed_slopes(found, both)
            found = found if slopes is None else both
        rows = accel_rows(model, found.mean, means, None if slopes is None else away)
        triads.append(_triad(model.names, found.first(len(model.names)), target, rows, slopes))
        lacking = _lacking(model, rows, means, found)
    if rests and rests[0].gyro is not None:
        free = np.array([not r.held for r in rests])
        own_away = None if away is None else away[free]
        triads.append(_gyro_biases([r for r in rests if not r.held], target, own_away))
        if model is not None and campaign.model.gyro_estimator in (None, "gravity"):
            triads.append(_gyro_matrix(turns, triads[0], target, campaign, before))
    if rests:
        _require_known(target, triads)
    last = rests[-1].accel if rests and model is not None else None
    now = None if last is None else last / np.linalg.norm(last)
    return Estimate(tuple(triads), model, len(rests), lacking, now)


def counts_held(recording: Recording, campaign: Campaign) -> bool:
    """Whether rests that a hand held count: for the accelerometers by |a|, as in the batch estimate."""
    asked = campaign.model.accel_estimator
    if recording.accel is None or asked in ("none", "static", "reference"):
        return False
    return recording.reference_accel is None or asked == "invariant"


def accel_model(rests: list[Rest], campaign: Campaign) -> AccelModel | None:
    """The accelerometers' model by the campaign's choice or the columns; `None` where directions tell nothing."""
    asked = campaign.model.accel_estimator
    if not rests or rests[0].accel is None or asked in ("none", "static"):
        return None
    by_reference = rests[0].reference is not None and asked != "invariant"
    gravity = campaign.site.gravity
    return ByReference(gravity) if by_reference else ByMagnitude(gravity)


def limits_of(names: tuple[str, ...], target: Target) -> Float[np.ndarray, " parameter"]:
    """Limit of each parameter, SI; ∞ where nothing is asked."""
    said = [target.limit(name) for name in names]
    return np.array([np.inf if limit is None else limit for limit in said])


def _require_known(target: Target, triads: list[Triad]) -> None:
    """A target that no rest can reach is said at the first one. Raises `ValueError`."""
    names = [name for triad in triads for name in triad.names]
    for said, _ in target.limits:
        if all(Target("", ((said, 1.0),)).limit(name) is None for name in names):
            raise ValueError(
                f"target {said}: `live` does not tell it from these columns; it tells {', '.join(names)}."
            )


def _triad(
    names: tuple[str, ...],
    found: Posterior,
    target: Target,
    rows: Rows,
    slopes: Float[np.ndarray, "3"] | None = None,
) -> Triad:
    usual = float(np.median(rows.variance)) if len(rows.variance) else 0.0
    return Triad(names, found, limits_of(names, target), usual, slopes)


def _rest_means(rests: list[Rest]) -> RestMeans:
    accel = np.array([r.accel for r in rests])
    covariance = np.array([r.accel_covariance for r in rests])
    known = rests[0].reference is not None
    reference = np.array([r.reference for r in rests]) if known else None
    return RestMeans(accel, covariance, reference)


def _gyro_biases(
    rests: list[Rest], target: Target, away: Float[np.ndarray, " rest"] | None
) -> Triad:
    """Biases of the gyros: what they read at rest, with a scatter from rest to rest that all axes share."""
    names = tuple(f"gyro.bias[{i}]" for i in range(3))
    value = np.array([r.gyro for r in rests]).reshape(-1)
    covariance = np.array([r.gyro_covariance for r in rests]).reshape(-1, 3, 3)
    variance = np.diagonal(covariance, axis1=1, axis2=2).reshape(-1)
    rows = Rows(np.tile(np.eye(3), (len(rests), 1)), value, variance)
    std = np.full(3, PRIOR_RATE)
    found, slopes = posterior_of(rows, np.zeros(3), std), None
    if away is not None:
        sloped = with_slopes(rows, away, np.zeros(3))
        both = posterior_of(sloped, np.zeros(6), np.append(std, slope_std(std)))
        slopes = followed_slopes(found, both)
        found = found if slopes is None else both.first(3)
    return _triad(names, found, target, rows, slopes)


def _gyro_matrix(
    turns: Sequence[Turn],
    accel: Triad,
    target: Target,
    campaign: Campaign,
    before: Estimate | None,
) -> Triad:
    """The gyros' matrix by gravity's rotation; the prior alone while there is no turn."""
    std = np.full(9, PRIOR_MATRIX[campaign.grade or "consumer"])
    known = None
    if before is not None:
        known = next((t.posterior.mean for t in before.triads if t.names == TURNED), None)
    start = np.zeros(9) if known is None else known
    force = lambda outputs: compensated(accel.posterior.mean, np.array(outputs).reshape(-1, 3))
    first, last = force([t.before for t in turns]), force([t.after for t in turns])
    direction = 2.0 * (accel.own_variance + accel.posterior.scatter_variance)
    variance = np.array([t.walk for t in turns]) + direction / campaign.site.gravity**2
    rows, found = None, None
    for _ in range(_MOST_STEPS):
        turned = [_integrated(t, start.reshape(3, 3)) for t in turns]
        rows = turn_rows(turned, first, last, variance)
        found = posterior_of(rows, np.zeros(9), std)
        moved, start = found.mean - start, found.mean
        if np.all(np.abs(moved) < LINEAR):
            break
    assert rows is not None and found is not None
    return _triad(TURNED, found, target, rows)


def _integrated(turn: Turn, matrix: Float[np.ndarray, "3 3"]) -> Turned:
    """A turn integrated with a matrix near enough to this one, kept with it."""
    kept = turn.kept
    if not kept or np.abs(kept[-1].matrix - matrix).max() > LINEAR:
        kept.append(integrated(turn, matrix))
        del kept[:-1]
    return kept[-1]


def _lacking(model: AccelModel, rows: Rows, means: RestMeans, found: Posterior) -> str | None:
    """What rests alone, without priors, lack to tell all parameters well enough for the batch estimate to keep them.

    `None` where they lack nothing.
    """
    unknowns = rows.jacobian.shape[1]
    missing = unknowns + FEWEST_FREEDOM - len(rows.value)
    if missing > 0:
        further = -(-missing // (len(rows.value) // len(means.accel)))
        return (
            f"{further} further rest{'s check' if further > 1 else ' checks'} the noise ({unknowns} unknowns and "
            f"{FEWEST_FREEDOM} to spare)"
        )
    if isinstance(model, ByMagnitude) and num_directions(means.accel) < FEWEST_DIRECTIONS:
        return f"the rests need {FEWEST_DIRECTIONS} directions that are apart"
    untold = "the rests do not yet tell the misalignments"
    weight = 1.0 / (np.maximum(rows.variance, 1e-14) + found.scatter_variance)
    information = (rows.jacobian * weight[:, None]).T @ rows.jacobian
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    values = np.linalg.eigvalsh(information * np.outer(scale, scale))
    if values[0] < 1e-10 * values[-1]:
        return untold
    std = np.sqrt(np.diagonal(np.linalg.inv(information)))
    angles = [s for s, n in zip(std, model.names) if ".matrix[" in n and n[-4] != n[-2]]
    return untold if max(angles) > MISALIGNED else None
