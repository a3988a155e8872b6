"""What the score statistics of a whole fleet say: effects common to the line, and effects of single devices.

The amplitudes of one term over the devices are α_d ~ N(μ, σ_d² + τ²). A mean μ that is not zero is common to
the line. Where the devices agree within their own uncertainties (τ small beside μ), they share its cause: the
rig, its reference or its stated gravity; where they spread, it is a property of the sensors' make. A device far
from the others has an effect of its own. Uncertainties come from the spread over devices, so that a wrong noise
model of the dwells does not raise an alarm.

**Reference:** DerSimonian and Laird, *Meta-analysis in clinical trials* (1986), for μ and τ.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtri, stdtr

from .score_statistics import FleetScores, Term


FALSE_ALARM = 0.01  # for the whole fleet, all terms together
ALIKE = 0.9  # signatures that correlate more are one group: the plan cannot tell them apart
SHARED_SPREAD = 0.2  # tau / |mean| below which devices agree
TINY = (
    1e-150  # the least uncertainty of a mean: t stays a number where devices agree in every digit
)
FEWEST = 8  # devices, for a mean with an uncertainty


class Common(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An effect that the line has in common."""

    term: Term
    mean: float  # of the amplitude, in the term's unit
    mean_sigma: float
    spread: float  # tau: between devices, beyond their own uncertainties
    z: float
    rivals: tuple[Term, ...]  # terms that this plan does not tell from it
    shared_cause: bool  # whether all devices have the same amount

    @property
    def cause(self) -> str:
        """Where to look for it, in words."""
        if self.shared_cause:
            return "the same in all devices, which points to the rig, its reference or the stated gravity"
        return (
            f"different from device to device (spread {self.spread:.2g}), which points to the "
            "sensors' make"
        )

    @property
    def sentence(self) -> str:
        """In words."""
        size = f"{self.mean:.3g} ± {self.mean_sigma:.1g} {self.term.unit}"
        where = "" if self.term.channel == "all" else f" on {self.term.channel}"
        names = sorted({t.name for t in self.rivals} - {self.term.name})
        doubt = f"; this plan does not tell it from {', '.join(names)}" if names else ""
        return f"{self.term.name}{where}: {size}, {self.cause}{doubt}"


class Single(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An effect that one device has and the others have not."""

    device: str
    term: Term
    amplitude: float  # beyond the line's mean
    sigma: float
    z: float
    rivals: tuple[Term, ...]

    @property
    def sentence(self) -> str:
        """In words."""
        where = "" if self.term.channel == "all" else f" on {self.term.channel}"
        names = sorted({t.name for t in self.rivals} - {self.term.name})
        doubt = f" (or {', '.join(names)})" if names else ""
        return (
            f"device '{self.device}': {self.term.name}{where}{doubt}, {self.amplitude:.3g} ± "
            f"{self.sigma:.1g} {self.term.unit} beyond the line's"
        )


class LineMismatch(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the catalogue finds in a fleet."""

    triad: str
    devices: int
    common: tuple[Common, ...]  # strongest first
    single: tuple[Single, ...]  # greatest first

    @property
    def sentences(self) -> tuple[str, ...]:
        """In words: the line's effects, or that there are none, and how many devices are unlike it."""
        if self.common:
            said = [f"{self.triad}: the line has {c.sentence}." for c in self.common]
        else:
            said = [f"{self.triad}: {self.devices} devices have no effect in common."]
        if self.single:
            count = len(self.single)
            said.append(
                f"{self.triad}: {count} device{'s have effects' if count > 1 else ' has an effect'} of "
                f"{'their' if count > 1 else 'its'} own, the greatest: {self.single[0].sentence}."
            )
        return tuple(said)


def read_line(
    triad: str, names: Sequence[str], scores: FleetScores, *, most: int = 3, listed: int = 100
) -> LineMismatch:
    """Tell common effects from those of single devices.

    **Arguments:** `names` are the devices' serial numbers in the order of `scores`; at most `most` common
    effects are sought, one after the other, each with those before it taken out; `listed` bounds the single devices.

    Raises `ValueError` for fewer than eight devices: the spread between them is then not known.
    """
    amplitude, sigma = scores.amplitude.copy(), scores.sigma
    usable = np.isfinite(amplitude).any(axis=1)
    if usable.sum() < FEWEST:
        raise ValueError(
            f"`read_line`: {int(usable.sum())} devices have residuals to compare; at least {FEWEST} are "
            "needed. Use `inertiax diagnose` for each."
        )
    common: list[Common] = []
    while len(common) < most:
        found = _strongest(amplitude, sigma, scores, common)
        if found is None:
            break
        common.append(found)
        k = scores.terms.index(found.term)
        amplitude = amplitude - found.mean * _leak(scores.overlap, sigma, k)
    single = _single(names, amplitude, scores, listed)
    return LineMismatch(triad, int(usable.sum()), tuple(common), single)


def _leak(
    overlap: Float[np.ndarray, "terms terms"], sigma: Float[np.ndarray, "devices terms"], k: int
) -> Float[np.ndarray, "devices terms"]:
    """Amplitude that every term shows for a unit of term k."""
    return overlap[:, k][None] * sigma / sigma[:, k : k + 1]


def _mean(
    amplitude: Float[np.ndarray, " devices"], sigma: Float[np.ndarray, " devices"]
) -> tuple[float, float, float]:
    """Mean, its standard deviation and tau, robust against a twentieth of outlying devices."""
    centre = np.median(amplitude)
    width = np.maximum(1.4826 * np.median(np.abs(amplitude - centre)), np.median(sigma) * 1e-3)
    kept = np.abs(amplitude - centre) < 5.0 * width
    a, s = amplitude[kept], sigma[kept]
    count = len(a)
    weight = 1.0 / np.square(s)
    fixed = np.sum(weight * a) / np.sum(weight)
    excess = np.sum(weight * np.square(a - fixed)) - (count - 1)
    tau2 = max(excess / (np.sum(weight) - np.sum(weight**2) / np.sum(weight)), 0.0)
    weight = 1.0 / (np.square(s) + tau2)
    mean = float(np.sum(weight * a) / np.sum(weight))
    # From the spread that is there, whatever the devices say of their own noise.
    scatter = np.sum(weight * np.square(a - mean)) / (count - 1)
    return mean, float(np.sqrt(scatter / np.sum(weight))), float(np.sqrt(tau2))


def _strongest(
    amplitude: Float[np.ndarray, "devices terms"],
    sigma: Float[np.ndarray, "devices terms"],
    scores: FleetScores,
    before: Sequence[Common],
) -> Common | None:
    """The term whose mean is farthest from zero, if that is significant among all terms."""
    taken = {scores.terms.index(c.term) for c in before}
    best: tuple[float, int, tuple[float, float, float], int] | None = None
    z_of = np.zeros(len(scores.terms))
    for k in range(len(scores.terms)):
        there = np.isfinite(amplitude[:, k])
        if k in taken or there.sum() < FEWEST:
            continue
        mean = _mean(amplitude[there, k], sigma[there, k])
        # Student's t, as a normal deviate.
        z_of[k] = _normal_deviate(abs(mean[0]) / max(mean[1], TINY), int(there.sum()) - 1)
        if best is None or z_of[k] > best[0]:
            best = (float(z_of[k]), k, mean, int(there.sum()))
    if best is None or best[0] < -ndtri(FALSE_ALARM / 2 / len(scores.terms)):
        return None
    z, k, (mean, mean_sigma, tau), _ = best
    alike = (np.abs(scores.overlap[k]) > ALIKE) & (z_of > 0.8 * z)
    rivals = tuple(t for j, t in enumerate(scores.terms) if alike[j] and j != k)
    # Between devices the amount of a common cause varies by no more than a part of itself.
    shared = tau < SHARED_SPREAD * abs(mean)
    return Common(
        scores.terms[k], mean, mean_sigma, tau, float(np.copysign(z, mean)), rivals, shared
    )


def _normal_deviate(t: float, freedom: int) -> float:
    """z with P(Z > z) = P(T > t), T of Student's distribution.

    Where that chance is below double precision by the closed form of Wallace, *Bounds on normal approximations to
    Student's and the chi-square distributions* (1959), which is then exact to three digits.
    """
    chance = stdtr(freedom, -t)
    if chance > 1e-300:
        return float(-ndtri(chance))
    shrink = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    return float(shrink * np.sqrt(freedom * np.log1p(t / freedom * t)))


def _single(
    names: Sequence[str],
    amplitude: Float[np.ndarray, "devices terms"],
    scores: FleetScores,
    listed: int,
) -> tuple[Single, ...]:
    """Devices far from the others, each with the term that explains it best."""
    z = np.zeros_like(amplitude)
    centre, width = np.zeros(amplitude.shape[1]), np.zeros(amplitude.shape[1])
    for k in range(amplitude.shape[1]):
        there = np.isfinite(amplitude[:, k])
        if there.sum() < FEWEST:
            continue
        centre[k] = np.median(amplitude[there, k])
        spread = 1.4826 * np.median(np.abs(amplitude[there, k] - centre[k]))
        width[k] = np.sqrt(max(spread**2 - np.median(scores.sigma[there, k]) ** 2, 0.0))
        total = np.sqrt(np.square(scores.sigma[there, k]) + width[k] ** 2)
        # Devices of few dwells know their own noise badly; the fleet's spread is the least to reckon with.
        z[there, k] = (amplitude[there, k] - centre[k]) / np.maximum(total, spread)
    worst = np.argmax(np.abs(z), axis=1)
    height = np.abs(z[np.arange(len(z)), worst])
    limit = -ndtri(FALSE_ALARM / 2 / max(int(np.isfinite(amplitude).sum()), 1))
    order = [d for d in np.argsort(-height) if height[d] > limit][:listed]
    made = []
    for d in order:
        k = int(worst[d])
        rivals: Bool[np.ndarray, " terms"] = (np.abs(scores.overlap[k]) > ALIKE) & (
            np.abs(z[d]) > 0.8 * height[d]
        )
        made.append(
            Single(
                names[int(d)],
                scores.terms[k],
                float(amplitude[d, k] - centre[k]),
                float(scores.sigma[d, k]),
                float(z[d, k]),
                tuple(t for j, t in enumerate(scores.terms) if rivals[j] and j != k),
            )  # fmt: skip
        )
    return tuple(made)
