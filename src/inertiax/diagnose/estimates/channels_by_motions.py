"""Which channel has an effect of accelerometers that are known by |f| alone: gyros tell, by gravity's turn in motions.

An addition e to the outputs changes |f| by its product with f, and so additions to different channels may change it
alike: f_p f_o on channel i is f_x f_y f_z on each of the three. What they make of the direction of f differs. Where
gyros were calibrated by the turn of that direction between rests, each channel is tried in turn: what the effect adds
there is taken away, accelerometers and gyros are calibrated again, and the motions are asked which of them they fit.
With the effect on a wrong channel the directions at both ends of each motion are off by its size.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.special
from jaxtyping import Float

from ...calibrate.pipeline import calibrate_device
from ...calibrate.results import TriadResult
from ...estimators import GravityRotation
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..observations.log_outputs import with_outputs
from ..problem import Prepared, Problem
from ..selection.evidence import Candidate
from ..selection.verdict import Answer, Named, SAME
from .applied_effects import fitted_effects
from .augmented_calibration import Beside, without_effects


FEWEST = 9  # motions of two rows each: as many rows beyond Θ's nine elements as these take up (convention)


def told_by_motions(problem: Problem, prepared: Prepared, answer: Answer) -> Answer:
    """The answer on accelerometers with each effect on the channel that the gyros' motions fit, where they tell.

    Channels that they do not exclude stay `elsewhere`, with odds; where there are no such motions all stay.
    """
    gyro = problem.fitted.gyro
    if gyro is None or prepared.form.triad != "accel" or not prepared.form.by_magnitude:
        return answer
    if not isinstance(gyro.estimator, GravityRotation) or len(gyro.misfit) < FEWEST:
        return answer
    named = list(answer.named)
    for k, one in enumerate(named):
        if one.elsewhere:
            others = [n.candidate.term for j, n in enumerate(named) if j != k]
            named[k] = _on_channel(problem, prepared, answer.noise, one, others)
    return replace(answer, named=tuple(named))


def _on_channel(
    problem: Problem, prepared: Prepared, noise: NoiseFit, named: Named, others: Sequence[Term]
) -> Named:
    """The name on the channel that rests and motions together make the likeliest, the others within the set's bound."""
    readings = [named.candidate, *named.elsewhere]
    gyros = [_gyros_beside(problem, prepared, noise, [*others, c.term]) for c in readings]
    squares = _squares([g for g in gyros if g is not None])
    if squares is None or len(squares) < len(readings):
        return named
    best = squares[int(np.argmin(squares.sum(axis=1)))]
    joint = [c.evidence + log_odds(s - best) for c, s in zip(readings, squares, strict=True)]
    lead = int(np.argmax(joint))
    # The name's own odds stay as its rests have them: they are of names, and these of channels.
    shift = named.candidate.evidence - joint[lead]
    asked = [replace(c, evidence=j + shift) for c, j in zip(readings, joint, strict=True)]
    first = asked.pop(lead)
    asked.sort(key=lambda c: -c.evidence)

    def within(c: Candidate) -> bool:
        return 2.0 * (first.evidence - c.evidence) < SAME

    return replace(named, candidate=first, elsewhere=tuple(filter(within, asked)))


def _gyros_beside(
    problem: Problem, prepared: Prepared, noise: NoiseFit, terms: Sequence[Term]
) -> TriadResult | None:
    """The gyros by motions between directions of f without the effects; `None` where that cannot be calibrated."""
    pairs = fitted_effects(prepared, noise, terms)
    beside = Beside(prepared, tuple(t for t, _ in pairs), tuple(s for _, s in pairs))
    campaign = with_outputs(problem.campaign, without_effects(problem.log, beside))
    try:
        return calibrate_device(
            campaign, model=problem.plain.model, checked=True, segments=problem.plain.segments
        ).gyro
    except ValueError:  # which says why, of a channel that is only tried
        return None


def _squares(gyros: Sequence[TriadResult]) -> Float[np.ndarray, "reading motion"] | None:
    """Square of each motion's misfit over its variance with each reading; `None` where they share few motions.

    The scatter beyond the motions' own noise is that of the reading which leaves least: what another adds to it is the
    misfit that is asked for.
    """
    if not gyros:
        return None
    times = [np.asarray(g.dwells.time) for g in gyros]
    common = times[0][np.all([np.isin(times[0], t) for t in times], axis=0)]
    if len(common) < FEWEST:
        return None
    scatter = min(g.scatter for g in gyros)
    made = []
    for g, time in zip(gyros, times, strict=True):
        rows = np.isin(time, common)
        own = np.square(g.sigma) - g.scatter**2
        made.append((np.square(g.misfit) / (own + scatter**2)).sum(axis=1)[rows])
    return np.stack(made)


def log_odds(worse: Float[np.ndarray, " motion"]) -> float:
    r"""Log odds of a reading by how much more it leaves of each motion than the best one does; at most 0.

    With $d_m$ of the motions in their order, $t = \sum d_m / \sqrt{\sum d_m^2 + 2 \cdot \tfrac12 \sum d_m d_{m+1}}$
    and the odds $\Phi(-t) / \Phi(t)$, which ask nothing of the form of their noise. Neighbours share a rest, whose
    error is in both, hence the second sum (Newey and West, Econometrica 55 (1987) 703, at one lag).
    """
    variance = worse @ worse + max(float(worse[1:] @ worse[:-1]), 0.0)
    t = max(float(worse.sum()) / max(float(np.sqrt(variance)), 1e-300), 0.0)
    return float(scipy.special.log_ndtr(-t) - scipy.special.log_ndtr(t))
