"""From campaigns of several units of one type to what is known of the type's noise."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from .._jax import jax
from ..data.recording import Campaign, Rig
from ..numerics.blas_threads import one_blas_thread
from .findings import find_all, silent
from .noise.type_noise import chain_labels, learn_chain, of_variances, TypeNoise
from .problem import prepare, Prepared


FEWEST = 2  # units; a single one cannot tell its own noise from that of its type


@one_blas_thread()
def learn_noise(
    campaigns: Sequence[tuple[str, Campaign]],
    *,
    consistent: bool = False,
    progress: Callable[[str], None] = silent,
) -> TypeNoise:
    """Learn the noise of a type of device from one-device campaigns of several units.

    **Arguments:** `campaigns` are pairs of a unit's name and its campaign; all need the same triads and
    estimators, and a rig whose stated uncertainties are the same. Each unit is diagnosed first: one whose model
    lacks physics, or that cannot be diagnosed, does not tell the noise and is left out with the reason. With
    `consistent` the units are known to lack nothing, from diagnoses made before, and only their rows are made.
    **Returns** a `TypeNoise`, for `diagnose(..., noise=...)`.
    Raises `ValueError` where the campaigns do not go together or fewer than two consistent units remain.
    """
    if len(campaigns) < FEWEST:
        raise ValueError(
            f"`learn_noise(campaigns)`: {len(campaigns)} unit; at least {FEWEST} are needed, better four or more."
        )
    taken: list[tuple[str, Sequence[Prepared]]] = []
    left_out = []
    with jax.enable_x64(True):
        _require_one_rig(campaigns)
        for number, (name, campaign) in enumerate(campaigns, start=1):
            progress(f"unit {number} of {len(campaigns)}: {name}")
            try:
                triads = prepare(campaign).triads
                why = None if consistent else _lacking(triads, campaign.grade)
            except ValueError as error:  # one bad unit does not stop the others
                triads, why = [], str(error)
            if why is None:
                taken.append((name, triads))
            else:
                left_out.append((name, why))
                progress(f"{name} left out: {why}")
        if len(taken) < FEWEST:
            said = "; ".join(f"{name}: {why}" for name, why in left_out)
            raise ValueError(
                f"`learn_noise(campaigns)`: {len(taken)} of {len(campaigns)} units are consistent with their model, "
                f"and {FEWEST} are needed ({said})."
            )
        found = pool(taken, campaigns[0][1].rig, tuple(left_out), progress)
        return replace(found, diagnosed=not consistent)


def _lacking(triads: Sequence[Prepared], grade: str | None) -> str | None:
    """What a unit's model lacks; `None` where it is consistent."""
    found = find_all(triads, grade, silent)
    if all(f.verdict == "consistent" for f in found):
        return None
    names = [n.candidate.term.name for f in found for n in f.answer.named]
    return ", ".join(names) or "something unexplained"


def pool(
    units: Sequence[tuple[str, Sequence[Prepared]]],
    rig: Rig,
    left_out: tuple[tuple[str, str], ...] = (),
    progress: Callable[[str], None] = silent,
) -> TypeNoise:
    """The noise of prepared units that lack nothing. Raises `ValueError` where their rows differ in kind."""
    first = [x for p in units[0][1] for x in chain_labels(p.system)]
    for name, triads in units:
        mine = [x for p in triads for x in chain_labels(p.system)]
        if mine != first:
            raise ValueError(
                f"unit {name} has rows of {', '.join(mine)}, unit {units[0][0]} of {', '.join(first)}; "
                "learn from campaigns with the same sensors and estimators."
            )
    chains = []
    for k, prepared in enumerate(units[0][1]):
        systems = [triads[k].system for _, triads in units]
        for c, label in enumerate(chain_labels(prepared.system)):
            progress(f"noise of {label}")
            chains.append(learn_chain(systems, c, label))
    return TypeNoise(tuple(chains), rig, tuple(name for name, _ in units), left_out)


def _require_one_rig(campaigns: Sequence[tuple[str, Campaign]]) -> None:
    """What a rig promises is the unit of two of the variances."""
    name, first = campaigns[0]
    for other, campaign in campaigns:
        if of_variances(campaign.rig) != of_variances(first.rig):
            raise ValueError(
                f"[rig] of {other} differs from that of {name}; the noise is learned on one station."
            )
