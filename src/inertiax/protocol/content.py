"""What a protocol shows people, in order: the sections that the page and the PDF have in common."""

import math
from collections.abc import Sequence

from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.effect_units import in_words, Shown, shown_parameter
from ..calibration.quantities import customary_units, label, with_sigma
from ..exports.extrapolation import margin
from ..report.judge import TRIAD_NAMES
from ..report.page import Key, Section, Table, Verdict
from .effect_results import EffectResult
from .expanded_uncertainty import COVERAGE
from .guard_band import RISK
from .identity import JUDGED, readable
from .protocol import DISCLAIMER, Protocol
from .requirements import Requirement
from .results import Result


_SIDE_BY_SIDE = 4  # temperatures in one table
_LINE = "_" * 24  # where people write
# Of the combined uncertainty; less changes it by less than 13 millionths, and is not shown.
_LEAST = 5e-3
_LISTED = 12  # values outside a limit; protocol.json has all


def title(protocol: Protocol) -> str:
    """The page's title."""
    device = protocol.calibration.device
    return f"Calibration protocol of {device}" if device else "Calibration protocol"


def under(protocol: Protocol) -> str:
    """The line below the title."""
    return (
        f"Certificate {protocol.certificate}. Written {readable(protocol.created)}; calibrated "
        f"{readable(protocol.record.created)}."
    )


# Of a fit, as `calibrate` judges it: the tone where nothing else is decided, and what is said.
_FITS = {
    "good": ("good", ()),
    "usable": ("attention", ("The fit is usable with a reservation, see Deviations.",)),
    "doubtful": (
        "bad",
        ("The fit is doubtful, see Deviations; do not rely on these results yet.",),
    ),
}
_TONES = {"pass": "good", "undecided": "attention", "fail": "bad"}


def verdict(protocol: Protocol) -> Verdict:
    """Whether the requirements are met, in one sentence, and what the protocol does not claim."""
    decisions = [r.decision for r in protocol.requirements]
    tone, lines = _FITS[protocol.record.verdict]
    if not decisions:
        headline = "Calibrated; no requirements were given."
        return Verdict(tone, headline, (*lines, DISCLAIMER))
    total = len(decisions)
    worst = next(d for d in ("fail", "undecided", "pass") if d in decisions)
    counted = ", ".join(
        f"{decisions.count(d)} {words}"
        for d, words in (("fail", "not met"), ("undecided", "undecided"), ("pass", "met"))
        if d in decisions
    )
    headline = (
        f"All {total} requirements are met." if worst == "pass" else f"Of {total} requirements: {counted}."
    )  # fmt: skip
    return Verdict(_TONES[worst], headline, (*lines, DISCLAIMER))


def keys(protocol: Protocol) -> list[Key]:
    """Key figures above the sections."""
    known = protocol.calibration.temperature_range
    found = [Key("Device", protocol.calibration.device or "not named")]
    if known is not None:
        found.append(Key("Temperature range", f"{float(known[0]):.1f} … {float(known[1]):.1f} °C"))
    found.append(Key("Fit", protocol.record.verdict, JUDGED))
    return found


def procedure(protocol: Protocol) -> Section:
    """Procedure and conditions as recorded."""
    record, station = protocol.record, protocol.record.station
    conditions, triads = record.conditions, []
    for name, triad in calibrated_triads(protocol.calibration).items():
        own = getattr(record, name)
        if own is not None:
            turns = f", {own.turns} of them at constant rate" if own.turns else ""
            triads.append(
                f"{TRIAD_NAMES[name]}: estimator '{triad.estimator}' ({record.method}), {own.dwells} dwells{turns}; "
                f"{own.degrees_of_freedom} degrees of freedom of the residuals."
            )
    rows = [("reference g", f"{station.gravity:.6f} m/s²", "")]
    for (words, factor, unit), entry in zip(_STATEMENTS, protocol.in_budget, strict=True):
        contained = "" if entry.stated is None else _CONTAINED[entry.contained]
        rows.append((words, _stated(entry.stated, factor, unit), contained.format(entry.source)))
    recorded = "recordings: not kept"
    if conditions.recordings is not None:
        recorded = _counted(conditions.recordings, "recording")
    if conditions.samples is not None:
        recorded += f", {conditions.samples} samples"
    if conditions.seconds is not None:
        recorded += f", {conditions.seconds:.0f} s"
    if conditions.experiments and conditions.experiments > 1:
        recorded += f", {conditions.experiments} experiments"
    if conditions.temperature_range is not None:
        low, high = conditions.temperature_range
        recorded += f", {low:.2f} to {high:.2f} °C"
    table = Table(("stated by the station, 1 sigma", "", "in the uncertainties"), tuple(rows))
    return Section("Procedure and conditions", lines=(f"{recorded}.", *triads), tables=(table,))


# In the order of `in_budget`: words, factor from SI, unit.
_STATEMENTS = (
    ("  its uncertainty", 1.0, "m/s²"),
    ("position", 180.0 / math.pi * 3600.0, "″"),
    ("level of the base", 180.0 / math.pi * 3600.0, "″"),
    ("right angle of the axes", 180.0 / math.pi * 3600.0, "″"),
    ("rate of the table", 1e6, "ppm"),
    ("temperature probe", 1.0, "°C"),
)
_CONTAINED = {"yes": "as '{}'", "within fit": "within 'fit'", "no": "no"}


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _stated(value: float | None, factor: float, unit: str) -> str:
    return "not stated" if value is None else f"{factor * value:.3g} {unit}"


def requirements(protocol: Protocol) -> Section | None:
    """Limits and decisions; `None` where no requirements were given."""
    if not protocol.requirements:
        return None
    rows = tuple(
        (r.name, r.text, _in_limits_unit(r, r.worst), label(r.worst.name), _at(r.worst), r.decision)
        for r in protocol.requirements
    )
    head = ("requirement", "limit", "nearest to the limit", "parameter", "at °C", "decision")
    tables = [Table(head, rows, numeric=(2, 4))]
    outside = [(r, o) for r in protocol.requirements for o in r.outside]
    if outside:
        more = len(outside) - _LISTED
        others = dict.fromkeys(f"{r.name}: {label(o.result.name)}" for r, o in outside[_LISTED:])
        caption = "Every stated value that does not pass" + (
            f"; {more} more are in protocol.json ({', '.join(others)})" if more > 0 else ""
        )
        shown = tuple(
            (r.name, label(o.result.name), _at(o.result), _in_limits_unit(r, o.result), o.decision)
            for r, o in outside[:_LISTED]
        )
        head = ("requirement", "parameter", "at °C", "value", "decision")
        tables.append(Table(head, shown, numeric=(2, 3), caption=caption))
    line = (
        f"A pass or a fail is wrong with a probability of at most {100 * RISK:g} % (guarded acceptance and rejection, "
        "JCGM 106). It holds over the whole calibrated range, of absolute values."
    )
    lines = (line, *not_decided(protocol), *_beside(protocol))
    return Section("Requirements", lines=lines, tables=tuple(tables))


def not_decided(protocol: Protocol) -> list[str]:
    """Which requirements are not decided whatever the values are, a sentence for each reason."""
    reasons = dict.fromkeys(r.reason for r in protocol.requirements if r.reason)
    return [
        f"{', '.join(r.name for r in protocol.requirements if r.reason == why)}: not decided, because {why}."
        for why in reasons
    ]


def nearest_value(requirement: Requirement) -> str:
    """The value nearest to the limit, in the limit's unit, with the parameter that has it."""
    worst = requirement.worst
    return f"{_in_limits_unit(requirement, worst)}, {label(worst.name)}"


def _in_limits_unit(requirement: Requirement, result: Result) -> str:
    """A value in the unit in which its limit was written."""
    factor, unit = requirement.shown_in
    value, guard = with_sigma(factor * result.value, factor * result.expanded)
    return f"{value} ± {guard} {unit}"


def _at(result: Result) -> str:
    return "" if result.at is None else f"{result.at:.1f}"


def _beside(protocol: Protocol) -> list[str]:
    """Which decisions do not contain which effects, a sentence for each triad with effects."""
    said = []
    for triad in dict.fromkeys(
        r.name.partition(".")[0] for r in protocol.requirements if r.without
    ):
        names = [r.name for r in protocol.requirements if r.name.startswith(f"{triad}.")]
        channels: dict[str, list[str]] = {}
        for e in protocol.effects:
            if e.term and e.channels[0].startswith(f"{triad}_"):
                channels.setdefault(e.effect, []).extend(e.channels)
        found = "; ".join(
            f"{name} on {', '.join(dict.fromkeys(on))}" for name, on in channels.items()
        )
        said.append(
            f"{', '.join(names)}: decided on the parameters alone. They do not contain what is fitted beside them "
            f"and stated under Named effects: {found}."
        )
    return said


def effects(protocol: Protocol) -> Section | None:
    """Named effects with their expanded uncertainties; `None` where none was fitted."""
    if not protocol.effects:
        return None
    rows = tuple(
        (e.effect, ", ".join(e.channels), e.term or in_words(e.parameter), *_effect_text(e))
        for e in protocol.effects
    )
    line = (
        "What the model, or a diagnosis, fitted beside the parameters; they hold without it, and a reading needs both. "
        f"± is the expanded uncertainty of {100 * COVERAGE:g} %, its covariance taken as known."
    )
    lines = (line,)
    if any(e.effect == "size_effect" and e.value == 0.0 for e in protocol.effects):
        lines += (
            "Lever arms of 0 are those that no plateau shows: held at zero, as uncertain as the others are long.",
        )
    head = ("effect", "channel", "term", "value", "±", "unit")
    return Section("Named effects", lines=lines, tables=(Table(head, rows, numeric=(3, 4)),))


def _effect_text(effect: EffectResult) -> tuple[str, str, str]:
    """Value, expanded uncertainty and unit as the report of a diagnosis shows them."""
    shown = Shown(effect.value, effect.expanded, effect.unit)
    return shown_parameter(effect.effect, effect.parameter, shown)


def results(protocol: Protocol) -> list[Section]:
    """Values with expanded uncertainties, a section for each triad."""
    made = []
    for name in calibrated_triads(protocol.calibration):
        own = [r for r in protocol.results if r.name.startswith(f"{name}.")]
        if own:
            temperatures = list(dict.fromkeys(r.at for r in own))
            parts = [
                temperatures[k : k + _SIDE_BY_SIDE]
                for k in range(0, len(temperatures), _SIDE_BY_SIDE)
            ]
            tables = tuple(_values(protocol, own, part) for part in parts)
            line = (
                f"± is the expanded uncertainty of {100 * COVERAGE:g} %: k standard uncertainties, k of Student's t "
                "with ν effective degrees of freedom; shown are the fewest of the row."
            )
            lines = (line, *_just_outside(protocol))
            made.append(Section(f"{TRIAD_NAMES[name]}: results", lines=lines, tables=tables))
    return made


def _just_outside(protocol: Protocol) -> tuple[str, ...]:
    """Which temperatures lie a little outside the calibrated range."""
    known = protocol.calibration.temperature_range
    if known is None:
        return ()
    low, high = float(known[0]), float(known[1])
    out = [f"{t:.2f}" for t in protocol.temperatures if not low <= t <= high]
    if not out:
        return ()
    return (
        f"At {', '.join(out)} °C the curves go on beyond the calibrated {low:.2f} to {high:.2f} °C, by at most "
        f"{margin(protocol.calibration):.2g} °C, as compensation does too.",
    )


def _values(protocol: Protocol, own: list[Result], at: Sequence[float | None]) -> Table:
    rows = []
    for name in dict.fromkeys(r.name for r in own):
        mine = [r for r in own if r.name == name and r.at in at]
        factor, unit = _unit_of(protocol, mine[0])
        cells = [" ± ".join(with_sigma(factor * r.value, factor * r.expanded)) for r in mine]
        least = min(mine, key=lambda r: r.degrees)
        rows.append((label(name), *cells, unit, f"{least.coverage_factor:.2f}", _degrees(least)))
    columns = tuple("value" if t is None else f"at {t:.1f} °C" for t in at)
    numeric = (*range(1, 1 + len(at)), 2 + len(at), 3 + len(at))
    return Table(("parameter", *columns, "unit", "k", "ν"), tuple(rows), numeric=numeric)


def budgets(protocol: Protocol) -> list[Section]:
    """The sources' standard uncertainties at the middle temperature."""
    made = []
    for name in calibrated_triads(protocol.calibration):
        own = [r for r in protocol.results if r.name.startswith(f"{name}.")]
        if not own:
            continue
        temperatures = list(dict.fromkeys(r.at for r in own))
        middle = temperatures[len(temperatures) // 2]
        shown = [r for r in own if r.at == middle]
        sources = list(dict.fromkeys(source for r in shown for source, _ in r.budget))
        decimals = _decimals(protocol, shown)
        rows = tuple(_budget_row(protocol, r, sources, decimals) for r in shown)
        caption = "Standard uncertainties"
        caption += (
            ""
            if middle is None
            else f" at {middle:.1f} °C; other temperatures are in protocol.json"
        )
        head = ("parameter", *sources, "together", "unit")
        table = Table(head, rows, numeric=tuple(range(1, 2 + len(sources))), caption=caption)
        made.append(Section(f"{TRIAD_NAMES[name]}: uncertainty budget", tables=(table,)))
    return made


def _decimals(protocol: Protocol, results: Sequence[Result]) -> dict[str, int]:
    """By unit, as many as give three significant digits of the largest uncertainty in it."""
    largest: dict[str, float] = {}
    for result in results:
        factor, unit = _unit_of(protocol, result)
        largest[unit] = max(largest.get(unit, 0.0), factor * result.std)
    return {u: max(2 - math.floor(math.log10(s)), 0) if s > 0.0 else 0 for u, s in largest.items()}


def _budget_row(
    protocol: Protocol, result: Result, sources: list[str], by_unit: dict[str, int]
) -> tuple[str, ...]:
    factor, unit = _unit_of(protocol, result)
    own, total, decimals = dict(result.budget), factor * result.std, by_unit[unit]
    shown = (own.get(s, 0.0) for s in sources)
    cells = (f"{factor * std:.{decimals}f}" if std > _LEAST * result.std else "–" for std in shown)
    return (label(result.name), *cells, f"{total:.{decimals}f}", unit)


def limits_of_knowledge(protocol: Protocol) -> list[Section]:
    """What the station cannot know, deviations, and what was left out."""
    made = [Section("What this station cannot know", items=protocol.not_known)]
    if protocol.deviations:
        made.append(Section("Deviations", items=protocol.deviations))
    left = protocol.left_out or ("Nothing was left out.",)
    made.append(Section("Left out", items=left))
    if protocol.record.choices:
        made.append(Section("Chosen by the program", items=protocol.record.choices))
    return made


def inputs(protocol: Protocol, most: int | None = None) -> Section:
    """Files with their hashes; `most` of them, with a word on the others."""
    files = protocol.record.inputs
    shown = files if most is None else files[:most]
    rows = tuple((f.file, str(f.bytes), f.sha256) for f in shown)
    lines = () if rows else ("The files of the measurement are not recorded.",)
    if len(shown) < len(files):
        lines = (f"{len(files) - len(shown)} more files are listed in protocol.json.",)
    table = Table(("file", "bytes", "SHA-256"), rows, numeric=(1,))
    return Section("Inputs", lines=lines, tables=(table,) if rows else ())


def signatures(protocol: Protocol) -> Section:
    """Where people sign."""
    operator = protocol.station.station.operator or _LINE
    rows = (("measured by", operator, _LINE, _LINE), ("released by", _LINE, _LINE, _LINE))
    return Section("Signatures", tables=(Table(("", "name", "date", "signature"), rows),))


def _unit_of(protocol: Protocol, result: Result) -> tuple[float, str]:
    """Factor from SI and the unit in which people read a result."""
    triad = calibrated_triads(protocol.calibration)[result.name.partition(".")[0]]
    return dict(zip(triad.names, customary_units(triad), strict=True))[result.name]


def _degrees(result: Result) -> str:
    # More than this many are as good as known: k differs from that of the normal distribution by 0.1 %.
    return f"{result.degrees:.0f}" if result.degrees < 1000 else "∞"
