"""The protocol itself: everything that its pages and documents show, and its JSON form."""

import dataclasses
import datetime
import math
from typing import Any

import msgspec

from ..calibration.calibration import Calibration
from .certificate_number import certificate_number
from .effect_results import effect_results, EffectResult
from .in_budget import in_budget, InBudget, not_contained
from .make_record import software, time_text
from .measurement import Measurement
from .not_known import not_known
from .record import Record
from .requirements import judge_requirements, Limit, Requirement
from .results import range_grid, reference_temperatures, Result, results_at
from .station import Station


SCHEMA = "inertiax.protocol/1"
DISCLAIMER = (
    "This protocol states what was measured and computed. It claims no accreditation, and no traceability beyond the "
    "references that the station states."
)


@dataclasses.dataclass(frozen=True, eq=False)
class Protocol:
    """What was measured on one device, how well, and against which requirements."""

    calibration: Calibration
    record: Record
    station: Station
    created: str  # UTC
    software: dict[str, str]  # that wrote the protocol
    temperatures: tuple[float, ...]  # °C, of the results; empty where none was recorded
    results: tuple[Result, ...]
    effects: tuple[EffectResult, ...]  # named ones, beside the parameters
    requirements: tuple[Requirement, ...]
    not_known: tuple[str, ...]
    in_budget: tuple[InBudget, ...]  # what of the station's statements the uncertainties contain

    @property
    def left_out(self) -> tuple[str, ...]:
        """What was measured or found but is not in the results."""
        return self.record.left_out

    @property
    def certificate(self) -> str:
        """Its number, see `certificate_number`."""
        stated = [_result(r) for r in self.results] + [_effect(e) for e in self.effects]
        stated += [_requirement(r) for r in self.requirements]
        device = self.calibration.device
        return certificate_number(self.station, device, self.record, stated)

    @property
    def days(self) -> tuple[str, str]:
        """First and last day of the measurement, YYYY-MM-DD: as the station states them, else by the recordings' clock;
        empty where neither says them."""
        said, known = self.station.station, self.record.conditions
        begin, end = (said.begin or said.end, said.end or said.begin)
        if begin or known.begin is None or known.end is None:
            return begin, end
        return known.begin[:10], known.end[:10]

    @property
    def deviations(self) -> tuple[str, ...]:
        """What was out of the ordinary in the measurement."""
        return (*self.record.warnings, *self.record.findings)

    def document(self) -> dict[str, Any]:
        """The fields of `protocol.json`, SI; degrees of freedom that are not finite are `null`."""
        model = self.calibration.model
        return {
            "schema": SCHEMA,
            "device": self.calibration.device,
            "certificate": self.certificate,
            "created": self.created,
            "calibrated": self.record.created,
            "statement": DISCLAIMER,
            "station": _given(msgspec.to_builtins(self.station.station)),
            "item": _given(msgspec.to_builtins(self.station.device)),
            "software": self.software,
            "calibrated_with": self.record.software,
            "inputs": msgspec.to_builtins(self.record.inputs),
            "conditions": msgspec.to_builtins(self.record.conditions),
            "rig": msgspec.to_builtins(self.record.station),
            "model": {} if model is None else model.document(),
            "results": [_result(r) for r in self.results],
            "effects": [_effect(e) for e in self.effects],
            "requirements": [_requirement(r) for r in self.requirements],
            "in_budget": [i._asdict() for i in self.in_budget],
            "not_known": list(self.not_known),
            "left_out": list(self.left_out),
            "deviations": list(self.deviations),
        }  # fmt: skip


def decide_on(
    measured: Measurement,
    station: Station,
    limits: tuple[Limit, ...],
    temperatures: tuple[float, ...] | None = None,
) -> tuple[Requirement, ...]:
    """The decisions of a protocol alone; arguments and errors as of `make_protocol`."""
    calibration, record = measured.calibration, measured.record
    at = reference_temperatures(calibration, temperatures)
    uncertainty = station.station.gravity_uncertainty
    results = results_at(calibration, record, at, uncertainty)
    effects = effect_results(calibration, record)
    everywhere = results_at(calibration, record, range_grid(calibration, at), uncertainty)
    return judge_requirements(limits, results, everywhere, effects, _undecidable(record))


def _undecidable(record: Record) -> dict[str, str]:
    """By triad, why nothing is decided on it: of the triad itself, or of the whole fit."""
    found = {
        triad: own.undecidable
        for triad in ("accel", "gyro")
        if (own := getattr(record, triad)) is not None and own.undecidable
    }
    if record.verdict != "doubtful" or found:
        return found
    why = (*record.findings, *record.warnings, "the fit is doubtful")[0].rstrip(".")
    return dict.fromkeys(("accel", "gyro", "mag"), f"the calibration is not to be used: {why}")


def make_protocol(
    measured: Measurement,
    station: Station,
    limits: tuple[Limit, ...] = (),
    temperatures: tuple[float, ...] | None = None,
) -> Protocol:
    """The protocol of a results folder.

    **Arguments:** `temperatures` in °C are those at which results are stated; both ends and the middle of the
    calibrated range where none are given.

    Raises `ValueError` for a temperature outside that range, for a limit of what was not calibrated, and where the
    station names another device than the results do.
    """
    calibration, record = _named(measured.calibration, station.device.serial), measured.record
    at = reference_temperatures(calibration, temperatures)
    uncertainty = station.station.gravity_uncertainty
    results = results_at(calibration, record, at, uncertainty)
    effects = effect_results(calibration, record)
    contained = in_budget(calibration, record, uncertainty, results)
    judged = decide_on(measured, station, limits, at) if limits else ()
    return Protocol(
        calibration=calibration,
        record=record,
        station=station,
        created=time_text(datetime.datetime.now(datetime.UTC)),
        software=software(),
        temperatures=at,
        results=results,
        effects=effects,
        requirements=judged,
        not_known=(*not_known(calibration, record, uncertainty), *not_contained(contained)),
        in_budget=contained,
    )


def _named(calibration: Calibration, serial: str) -> Calibration:
    """The calibration with the serial number that the station states, where it has none."""
    if serial and calibration.device not in ("", serial):
        raise ValueError(
            f"the results are of device {calibration.device!r}, but the station's [device] serial is {serial!r}; leave "
            "serial out."
        )
    return dataclasses.replace(calibration, device=serial or calibration.device)


def _given(table: dict[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in table.items() if v not in ("", None)}


def _effect(effect: EffectResult) -> dict[str, Any]:
    return {
        **effect._asdict(),
        "expanded": effect.expanded,
        "coverage_factor": effect.coverage_factor,
    }


def _requirement(r: Requirement) -> dict[str, Any]:
    return {
        "name": r.name, "limit": r.limit, "unit": r.unit, "decision": r.decision,
        "worst": _value(r.worst),
        "outside": [{**_value(o.result), "decision": o.decision} for o in r.outside],
        "without_effects": list(r.without), "reason": r.reason,
    }  # fmt: skip


def _value(result: Result) -> dict[str, Any]:
    return {k: getattr(result, k) for k in ("name", "at", "value", "expanded")}


def _result(result: Result) -> dict[str, Any]:
    return {
        "name": result.name,
        "at": result.at,
        "value": result.value,
        "std": result.std,
        "expanded": result.expanded,
        "coverage_factor": result.coverage_factor,
        "degrees_of_freedom": result.degrees if math.isfinite(result.degrees) else None,
        "unit": result.unit,
        "budget": [{"source": source, "std": std} for source, std in result.budget],
    }
