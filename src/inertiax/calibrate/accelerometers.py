"""The accelerometers' estimate, with misalignments where the positions determine them."""

import dataclasses

import numpy as np

from ..data.recording import Campaign
from ..model_selection.select_model import build_estimators, ChosenModel
from ..physics.temperature import Constant
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .between_dwell_variance import with_provisional_scatter
from .goodness_of_fit import LIMITS
from .held_misalignments import stated_with_held
from .one_triad import (
    estimate_triad,
    Progress,
    require_observable,
    rows_for,
    TooHighDegree,
)
from .results import TriadResult


# rad: rests that tell a misalignment no better than its usual size tell nothing of it, and it only bends the other
# parameters.
MISALIGNED = LIMITS.usual_size["accel.matrix"]
UNKNOWNS = 9  # of the invariant model
FACES = 6  # rests with which biases and scale factors alone are usually meant
_BETWEEN = "add positions between the axes"


def calibrate_accelerometers(
    campaign: Campaign,
    chosen: ChosenModel,
    dwells: Dwells,
    method: str,
    robust: float | None,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> tuple[TriadResult, ChosenModel]:
    """The accelerometers' estimate, and the model without misalignments where the rests do not determine them."""
    used = rows_for("accel", chosen, dwells)

    def estimate(model: ChosenModel, said: list[str], mine: Dwells | None = None) -> TriadResult:
        accel, _ = build_estimators(model, campaign.site.gravity, dwells, robust=robust)
        assert accel is not None
        own = used if mine is None else mine
        found = estimate_triad(
            accel, own, model, method, progress, said, warnings, rig=campaign.rig
        )
        return stated_with_held(found)

    rests = np.flatnonzero(np.asarray(used.position) >= 0)
    if chosen.lever_arms and 0 < len(rests) < used.num_dwells:
        # Lever arms come with the gyros; until then they would bend the curve, and the choice of its degree, at rates.
        said_at_rest: list[str] = []
        try:
            found = estimate(chosen, said_at_rest, used[rests])
        except ValueError:
            pass  # rests alone do not determine it
        else:
            choices.extend(said_at_rest)
            return found, chosen
    if chosen.fixed or chosen.accel_estimator != "invariant":
        return estimate(chosen, choices), chosen
    said: list[str] = []
    first, found, why = _misalignments(campaign, chosen, used, robust), None, ""
    if first:
        try:
            found = estimate(chosen, said)
        except TooHighDegree:
            raise  # misalignments are not at fault
        except ValueError:
            why = f"so badly that the estimation with them does not converge; {_BETWEEN}"
        else:
            known = _known_misalignments(found)
            if known <= MISALIGNED:
                choices.extend(said)
                return found, chosen
            why = f"no better than {1e3 * known:.2g} mrad; {_BETWEEN}"
    reason = (
        "accelerometers: biases and scale factors only, because the positions determine the misalignments "
        f"{why or _too_few(used)}"
    )
    smaller = dataclasses.replace(chosen, accel_misalignments=False)
    try:
        found = estimate(smaller, said := [])
    except ValueError:
        if found is None:
            return estimate(chosen, choices), chosen  # whose reason says what is missing
        smaller = chosen
    else:
        warnings.append(reason)
    choices.extend(said)
    return found, smaller


def _too_few(dwells: Dwells) -> str:
    """Why rests determine no misalignment, and what to do."""
    count = dwells.num_dwells
    if FACES < count < UNKNOWNS:
        return f"not at all: {count} rests for {UNKNOWNS} unknowns; add rests"
    return f"not at all; {_BETWEEN}"


def _misalignments(
    campaign: Campaign, chosen: ChosenModel, dwells: Dwells, robust: float | None
) -> bool:
    """Whether the rests determine all of an invariant model at one temperature."""
    accel, _ = build_estimators(chosen, campaign.site.gravity, dwells, robust=robust)
    assert accel is not None
    try:
        require_observable(with_provisional_scatter(accel, dwells), Constant(), dwells)
    except ValueError:
        return False
    return True


def _known_misalignments(found: TriadResult) -> float:
    """The largest standard deviation of a misalignment, rad, over the temperatures of the dwells."""
    own = [k for k, n in enumerate(found.estimator.names) if _is_misalignment(n)]
    phi = Problem(found.estimator, found.solution.curve.basis, found.dwells).phi
    size, count = phi.shape[1], found.estimator.num_parameters
    blocks = np.asarray(found.solution.covariance).reshape(size, count, size, count)
    variance = np.einsum("ta,aibi,tb->ti", phi, blocks[:, own][:, :, :, own], phi)
    return float(np.sqrt(variance.max()))


def _is_misalignment(name: str) -> bool:
    return ".matrix[" in name and name[-4] != name[-2]
