"""The audit of a plan as sentences and tables, for the terminal and the page."""

from collections.abc import Sequence

from ..calibration.effect_units import customary
from ..calibration.quantities import label
from ..diagnose.plan.limits import Audit, Detectable, POWER
from ..effects import CATALOGUE, Effect
from .page import Section, Table


_TRIADS = {"accel": "accelerometers", "gyro": "gyros"}
# Effects that a calibration may estimate beside its other parameters, and what those are called
_OF_THE_MODEL = {"g_sensitivity": "g_sensitivity", "size_effect": "lever_arm"}
_IN_RAMPS = "that are audited do not show it; a diagnosis looks for it in the ramps between them"
_COLUMNS = {
    "temperature, at_temperature": "temperature",
    "no at_temperature recorded or known": "the model meant has no temperature dependence",
    "temperature_rate": "rate of temperature",
    "room recorded or known": "attitude in the room recorded or known",
    "no vibration recorded or known": "the rests differ too little in vibration",
    "no force": "no specific force",
}


def audit_sections(
    audit: Audit, *, sizes: bool = True, catalogue: Sequence[Effect] = CATALOGUE
) -> list[Section]:
    """What the plan cannot tell, cannot tell apart, and from which size on it shows an effect."""
    made = []
    if sizes and audit.detectable:
        made.append(sizes_section(audit))
    made.append(_alike(audit))
    made.append(_blind(audit, catalogue))
    return [s for s in made if s.lines or s.tables]


def sizes_section(audit: Audit) -> Section:
    """The smallest size of each effect that the plan shows, axis by axis."""
    head = ("effect", "of", "x", "y", "z", "unit")
    lines = (
        f"The smallest size of each effect that a diagnosis of this campaign detects with a probability of "
        f"{100 * POWER:.0f} %, each in the form that shows it best, a step at half of the moments. A time constant "
        f"or a width is given where theory fixes the size of the effect itself.",
    )
    table = Table(head, tuple(size_rows(audit)), numeric=(2, 3, 4))
    return Section("The smallest sizes that would have shown", lines=lines, tables=(table,))


def size_rows(audit: Audit) -> list[tuple[str, ...]]:
    """One row for each effect and triad; a dash where an axis shows nothing."""
    groups: dict[tuple[str, str], list[Detectable]] = {}
    for d in audit.detectable:
        groups.setdefault((d.whole_name, d.channels[0].partition("_")[0]), []).append(d)
    rows = []
    for (name, triad), members in groups.items():
        factor, unit = customary(min(d.size for d in members), members[0].unit)
        cells = []
        for axis in "xyz":
            mine = [d.size for d in members if f"{triad}_{axis}" in d.channels]
            cells.append(three_digits(factor * min(mine)) if mine else "–")
        rows.append((name, _TRIADS[triad], *cells, unit))
    return rows


def three_digits(value: float) -> str:
    """A size to three digits, without a power of ten where it can be read."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _alike(audit: Audit) -> Section:
    """Sets that the plan shows in the same way, and the experiments that would part them."""
    rows = tuple(
        (
            " or ".join(s.names),
            ", ".join(s.channels),
            f"{s.r_squared:.3f}",
            "; or ".join(s.experiments),
        )
        for s in audit.sets
    )
    if not rows:
        return Section("What this plan cannot tell apart")
    head = ("effects that look alike", "channels", "R²", "experiment that would part them")
    lines = (
        "Beside the calibration these effects leave nearly the same signature in this plan (R² of their "
        "signatures), whatever the noise: a diagnosis can only name the set.",
    )
    return Section(
        "What this plan cannot tell apart", lines=lines, tables=(Table(head, rows, numeric=(2,)),)
    )


def _blind(audit: Audit, catalogue: Sequence[Effect]) -> Section:
    """Effects that the calibration absorbs or that the plan does not excite, and what it would take."""
    needs = {e.name: e.needs for e in catalogue}
    in_ramps = {e.name for e in catalogue if e.stream_delay}
    by = {a.name: a for a in audit.absorbed}
    rows = []
    other = [name for name, reason in audit.not_testable if reason.startswith("it is an effect")]
    for name, reason in audit.not_testable:
        if name in other:
            continue
        if name in by and by[name].by:
            shown = ", ".join(_parameter(p) for p in by[name].by)
            if all(_kind(p) == _OF_THE_MODEL.get(name) for p in by[name].by):
                rows.append((name, "the calibration estimates it as parameters of its own", ""))
                continue
            reason = f"the calibration absorbs it: it looks like {shown}"
        if reason.startswith("it needs"):
            streamed = name in in_ramps
            reason = (
                f"the rows of rests and plateaus {_IN_RAMPS}"
                if streamed
                else "this plan does not excite it"
            )
        rows.append((name, _plain(reason), needs.get(name, "")))
    lines = []
    if other:
        lines.append(f"Effects of sensors that are not in these recordings: {', '.join(other)}.")
    if audit.unobservable:
        lines.append(
            "Parameters of the calibration itself that this plan does not tell: "
            + "; ".join(_combination(text) for text in audit.unobservable)
            + "."
        )
    if not rows:
        return Section("What this plan says nothing about", lines=tuple(lines))
    table = Table(("effect", "why", "it would take"), tuple(rows))
    return Section("What this plan says nothing about", lines=tuple(lines), tables=(table,))


def _plain(reason: str) -> str:
    """A reason with the names of a signal's columns in words."""
    for column, words in _COLUMNS.items():
        reason = reason.replace(column, words)
    return reason


def _kind(name: str) -> str:
    """`lever_arm` of `accel.lever_arm[0,1]`."""
    return name.partition(".")[2].partition("[")[0]


def _parameter(name: str) -> str:
    triad = _TRIADS.get(name.partition(".")[0])
    return name if triad is None else f"{triad}' {label(name)}"


def _combination(text: str) -> str:
    words = [_parameter(w.rstrip(",")) + ("," if w.endswith(",") else "") for w in text.split()]
    return " ".join(words)
