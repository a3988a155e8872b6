"""Which of many candidates are worth a closer look: screening, forms between the grid's points, leaders."""

from collections.abc import Callable, Collection, Iterable, Sequence

import numpy as np

from ..candidates.empirical import PREFIX
from ..candidates.signatures import Term
from ..noise.common_mode_fit import recoupled
from ..noise.observation_series import NoiseFit, System
from .column_products import ColumnProducts
from .evidence import Bank, bank, Candidate, judge, refine, shortlist


SHARPER = 3  # times that the forms beside a leading candidate are tried
FAINT = 12.0  # likelihood ratio below which that is not worth it


def _quiet(noise: NoiseFit) -> NoiseFit:
    """The same noise with its slow parts much lower: shows slow effects that they may have swallowed."""
    lower = tuple(
        np.concatenate([t[:1], t[1:3] - 4.0, t[3:4] - 1.0, t[4:5] - 6.0, t[5:]])
        for t in noise.theta
    )
    lower = tuple(np.maximum(t, -9.0) for t in lower)
    return NoiseFit(lower, noise.value, recoupled(lower, noise.coupled))


def quiet_bank(noise: NoiseFit) -> Bank:
    """A bank of that much quieter noise alone; it compares candidates with each other and with nothing else."""
    return Bank((_quiet(noise),), (tuple(0.0 for _ in noise.theta),))


def carried(before: Bank, noise: NoiseFit, touched: Collection[int]) -> list[NoiseFit]:
    """What was fitted before on the chains that a new choice does not touch, with the new noise on those it does."""
    made = {}
    for fit in before.fits:
        theta = tuple(
            n if c in touched else t for c, (n, t) in enumerate(zip(noise.theta, fit.theta))
        )
        made[b"".join(t.tobytes() for t in theta)] = theta
    return [
        NoiseFit(t, noise.value, recoupled(t, noise.coupled), noise.curvature)
        for t in made.values()
    ]


def screen(
    system: System, noise: NoiseFit, everything: Sequence[Term], forms: dict, grade: str | None
) -> tuple[Bank, list[Candidate], list[Candidate], list[Term]]:
    """Every candidate under the fitted noise and under much less slow noise, best first, and a short list of both.

    The first ones' scores have their whitened columns.
    """
    first = bank(system, [noise], [])
    ranked = judge(system, first, everything, [], forms, grade, columns=True)
    slow = judge(system, quiet_bank(noise), everything, [], forms, grade)
    short = list(dict.fromkeys([*map(id, shortlist(ranked)), *map(id, shortlist(slow))]))
    by_id = {id(t): t for t in everything}
    return first, ranked, slow, [by_id[k] for k in short]


def finer_forms(
    ranked: Sequence[Candidate], slow: Sequence[Candidate], finer: Callable[[Term], list[Term]]
) -> list[Term]:
    """Forms between those of the grid, around the leading candidates that have a grid."""
    made: list[Term] = []
    for order, most in ((ranked, (5, 2)), (slow, (5, 4))):
        seen: tuple[set, set] = set(), set()
        for candidate in order[:400]:
            term, unlisted = candidate.term, is_open(candidate)
            known = seen[unlisted]
            if candidate.key in known or len(known) >= most[unlisted] or not _has_grid(term):
                continue
            known.add(candidate.key)
            if not any(
                t.variant.label == term.variant.label and t.channels == term.channels for t in made
            ):
                made.extend(finer(term))
    return made


def _has_grid(term: Term) -> bool:
    """Whether one of a term's settings was taken from a grid."""
    return bool(term.variant.settings) if term.effect is None else bool(term.effect.nuisance)


def is_open(candidate: Candidate) -> bool:
    """Whether a candidate is an unlisted dependence."""
    return candidate.term.name.startswith(PREFIX)


def leaders(ranked: Sequence[Candidate], listed: int, unlisted: int) -> list[Candidate]:
    """The best few effects and structured alternatives of each set of chains."""
    count: dict[tuple, int] = {}
    seen: set = set()
    made = []
    for candidate in ranked:
        group = (candidate.term.chains, is_open(candidate))
        if candidate.key in seen or count.get(group, 0) >= (unlisted if group[1] else listed):
            continue
        seen.add(candidate.key)
        count[group] = count.get(group, 0) + 1
        made.append(candidate)
    return made


def rank(
    system: System,
    noises: Sequence[NoiseFit],
    short: Sequence[Term],
    chosen: Sequence[Term],
    forms: dict,
    grade: str | None,
    extra: Sequence[Candidate] = (),
) -> tuple[Bank, list[Candidate]]:
    """Candidates beside the chosen terms, best first, with the noise fitted anew beside the leading and the `extra`."""
    start, products = bank(system, noises, chosen), ColumnProducts(system, short, chosen)
    ranked = judge(system, start, short, chosen, forms, grade, products=products)
    fuller = refine(system, start, [*leaders(ranked, 3, 2), *extra], chosen, most=8)
    return fuller, judge(system, fuller, short, chosen, forms, grade, products=products)


def sharpen(
    system: System,
    start: Bank,
    ranked: Sequence[Candidate],
    everything: Sequence[Term],
    finer: Callable[[Term], list[Term]],
    forms: dict,
    grade: str | None,
) -> list[Term]:
    """Forms beside the leading effect, the leading unlisted dependence and the leading step, nearer step by step.

    What a form between the grid's points leaves behind is taken for slow noise; only where that is fitted
    anew beside a near form does a nearer one show. A step that is a little off leaves the most of all, so that bumps
    lead where it belongs.
    """
    made: list[Term] = []
    gridded = [c for c in ranked if _has_grid(c.term)]
    leads = list(first_of_both(gridded))
    step = next((c for c in gridded if "step" in c.term.variant.settings), None)
    for lead in [*leads, *([] if step in leads else [step])]:
        for _ in range(SHARPER):
            if lead is None or lead.ratio < FAINT:
                break
            fuller = refine(system, start, [lead], [], most=1)
            same = [t for t in everything if (t.name, t.channels) == lead.key]
            near = [*same, lead.term, *finer(lead.term)]
            best = judge(system, fuller, near, [], forms, grade)[0]
            if best.term is lead.term:
                break
            made, lead = [*made, best.term, *finer(best.term)], best
    return made


def first_of_both(
    ranked: Iterable[Candidate],
) -> tuple[Candidate | None, Candidate | None]:
    """The best catalogued candidate and the best unlisted one."""
    listed = unlisted = None
    for candidate in ranked:
        if is_open(candidate):
            unlisted = unlisted or candidate
        else:
            listed = listed or candidate
        if listed is not None and unlisted is not None:
            break
    return listed, unlisted
