"""What the model of a fleet leaves out: the section of its page."""

from collections.abc import Sequence

from ..fleet.effects.population_effects import FEWEST, LineMismatch
from ..fleet.effects.score_statistics import Term
from .page import Section, Table


TITLE = "What the model leaves out"
LISTED = 100  # devices in a table


def section(found: Sequence[LineMismatch], calibrated: int) -> Section:
    """What the whole line shares and what single devices have, or that there are too few devices to tell."""
    if not found:
        return Section(TITLE, (too_few_to_explain(calibrated),))
    rows = [
        (
            "the line",
            *_term_cells(c.term),
            f"{c.mean:.3g} ± {c.mean_sigma:.1g}",
            f"{c.z:.1f}",
            c.cause,
        )
        for mismatch in found
        for c in mismatch.common
    ]
    rows += [
        (s.device, *_term_cells(s.term), f"{s.amplitude:.3g} ± {s.sigma:.1g}", f"{s.z:.1f}", "")
        for mismatch in found
        for s in mismatch.single[:LISTED]
    ]
    tables = ()
    if rows:
        head = ("where", "effect", "channel", "unit", "size ± 1 sigma", "sigmas", "cause")
        tables = (Table(head, tuple(rows)),)
    said = tuple(s for mismatch in found for s in mismatch.sentences)
    return Section(TITLE, said, tables=tables)


def too_few_to_explain(calibrated: int) -> str:
    """Why a run with `--explain` says nothing."""
    return (
        f"--explain compares devices, and needs {FEWEST} that are calibrated; here are {calibrated}. "
        "`inertiax diagnose` explains single devices."
    )


def _term_cells(term: Term) -> tuple[str, str, str]:
    return term.name, term.channel, term.unit
