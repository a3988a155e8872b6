"""Requirements decided for every device of a results folder: one table to read, and one for programs."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from ..report.page import Key, Section, Table, Verdict, write_page
from ..storage.whole_files import write_atomically
from .content import nearest_value
from .guard_band import RISK
from .measurement import Measurement
from .protocol import decide_on, DISCLAIMER
from .requirements import Limit, Requirement
from .station import Station


SCHEMA = "inertiax.decisions/1"
FILES = ("decisions.html", "decisions.json", "decisions.csv")
SET_ASIDE = "set aside"
LISTED = 500  # devices in the page, those that do not pass first
_ORDER = ("fail", "undecided", SET_ASIDE, "pass")


class DeviceDecisions(NamedTuple):
    """One device."""

    device: str
    fit: str  # good | usable | doubtful; empty where it was set aside
    decision: str  # fail where one requirement fails, else undecided where one is, else pass; or set aside
    requirements: tuple[Requirement, ...]
    reason: str = ""  # why it was set aside


def decide_on_all(
    found: Iterable[tuple[str, Measurement | str]], station: Station, limits: tuple[Limit, ...]
) -> tuple[DeviceDecisions, ...]:
    """The decisions on every device; of one that was set aside the reason.

    Raises `ValueError` for a limit of what was not calibrated, and for a station that names one device.
    """
    if station.device.serial:
        raise ValueError("the station's [device] serial names one device, but all are decided on.")
    made = []
    for device, measured in found:
        if isinstance(measured, str):
            made.append(DeviceDecisions(device, "", SET_ASIDE, (), measured))
            continue
        judged = decide_on(measured, station, limits)
        decisions = {r.decision for r in judged}
        worst = next(d for d in _ORDER if d in decisions)
        made.append(DeviceDecisions(device, measured.record.verdict, worst, judged))
    return tuple(made)


def counted(devices: Sequence[DeviceDecisions]) -> str:
    """How many devices pass, in one sentence."""
    times = Counter(d.decision for d in devices)
    words = {"pass": "pass", "fail": "fail", "undecided": "undecided", SET_ASIDE: SET_ASIDE}
    said = ", ".join(f"{times[d]} {words[d]}" for d in ("pass", *_ORDER[:3]) if times[d])
    return f"Of {len(devices)} devices: {said}."


def write_decisions(
    devices: Sequence[DeviceDecisions], limits: Sequence[Limit], folder: Path, command: str
) -> None:
    """Write `decisions.html`, `decisions.json` and `decisions.csv`."""
    folder.mkdir(parents=True, exist_ok=True)
    content = msgspec.json.encode(document(devices, limits))
    write_atomically(folder / "decisions.json", msgspec.json.format(content, indent=1) + b"\n")
    write_atomically(folder / "decisions.csv", _table(devices, limits).encode())
    _page(devices, limits, folder, command)


def document(devices: Sequence[DeviceDecisions], limits: Sequence[Limit]) -> dict[str, Any]:
    """The fields of `decisions.json`, SI."""
    return {
        "schema": SCHEMA,
        "requirements": [{"name": m.name, "limit": m.limit, "text": m.text} for m in limits],
        "devices": [
            {
                "device": d.device, "fit": d.fit, "decision": d.decision, "reason": d.reason,
                "requirements": [
                    {"name": r.name, "decision": r.decision, "parameter": r.worst.name, "at": r.worst.at,
                     "value": r.worst.value, "expanded": r.worst.expanded, "unit": r.unit, "reason": r.reason}
                    for r in d.requirements
                ],
            }
            for d in devices
        ],
    }  # fmt: skip


def _table(devices: Sequence[DeviceDecisions], limits: Sequence[Limit]) -> str:
    """A line for each device; values in the unit of their limit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [
        f"{m.name}{what}"
        for m in limits
        for what in ("", f" nearest [{m.shown_in[1]}]", f" expanded [{m.shown_in[1]}]")
    ]
    writer.writerow(["device", "fit", "decision", *heads, "reason"])
    for d in devices:
        cells: list[object] = []
        for r in d.requirements:
            factor, _ = r.shown_in
            nearest, expanded = factor * r.worst.value, factor * r.worst.expanded
            cells += [r.decision, f"{nearest:.6g}", f"{expanded:.2g}"]
        cells += [""] * (len(heads) - len(cells))
        why = "; ".join(dict.fromkeys(r.reason for r in d.requirements if r.reason))
        writer.writerow([d.device, d.fit, d.decision, *cells, d.reason or why])
    return text.getvalue()


def _page(
    devices: Sequence[DeviceDecisions], limits: Sequence[Limit], folder: Path, command: str
) -> None:
    times = Counter(d.decision for d in devices)
    fits = Counter(d.fit for d in devices if d.fit)
    tone = "bad" if times["fail"] else "good" if times["pass"] == len(devices) else "attention"
    said = ", ".join(f"{n} {fit}" for fit, n in fits.items())
    write_page(
        folder / "decisions.html",
        title=f"Requirements of {len(devices)} devices",
        under="The same decisions as in each device's protocol.",
        verdict=Verdict(tone, counted(devices), (DISCLAIMER,)),
        keys=[
            Key("Devices", str(len(devices))),
            Key("Fit", said, "by the rule of inertiax calibrate"),
        ],
        sections=[_by_requirement(devices, limits), _by_device(devices, limits)],
        command=command,
    )


def _by_requirement(devices: Sequence[DeviceDecisions], limits: Sequence[Limit]) -> Section:
    rows = []
    for k, limit in enumerate(limits):
        times = Counter(d.requirements[k].decision for d in devices if d.requirements)
        rows.append((limit.name, limit.text, *(str(times[d]) for d in ("pass", "undecided", "fail"))))  # fmt: skip
    line = (
        f"A pass or a fail of a device is wrong with a probability of at most {100 * RISK:g} % for each requirement "
        "(JCGM 106)."
    )
    head = ("requirement", "limit", "pass", "undecided", "fail")
    return Section("Requirements", lines=(line,), tables=(Table(head, tuple(rows), (2, 3, 4)),))


def _by_device(devices: Sequence[DeviceDecisions], limits: Sequence[Limit]) -> Section:
    ranked = sorted(devices, key=lambda d: _ORDER.index(d.decision))[:LISTED]
    rows = tuple(
        (
            d.device,
            d.decision,
            d.fit,
            *(f"{r.decision}: {nearest_value(r)}" for r in d.requirements),
            *([d.reason] + [""] * (len(limits) - 1) if d.reason else []),
        )
        for d in ranked
    )
    more = len(devices) - len(ranked)
    line = "Of each requirement the decision and the value nearest to the limit; those that do not pass come first."
    lines = (line, f"{more} more that pass are in decisions.csv.") if more else (line,)
    head = ("device", "all together", "fit", *(f"{m.name} within {m.text}" for m in limits))
    return Section("Devices", lines=lines, tables=(Table(head, rows),))
