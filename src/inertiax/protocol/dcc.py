"""`dcc.xml`: the protocol as a Digital Calibration Certificate, which other laboratories' programs read.

Schema of PTB, version 3.1.2, with quantities in D-SI 2.1.0. What the schema wants and nobody states is said to be
"not stated"; a country that is not known is ZZ, which ISO 3166 leaves to users. An undecided requirement has no
`conformity`, since the schema has no word for it, but a declaration.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.quantities import label
from ..report.judge import TRIAD_NAMES
from ..storage.harmless_text import one_line
from ..storage.whole_files import write_atomically
from .effect_results import EffectResult
from .expanded_uncertainty import COVERAGE
from .protocol import DISCLAIMER, Protocol
from .requirements import Requirement
from .results import Result
from .si_units import in_si


VERSION = "3.1.2"
_DCC, _SI, _XSI = (
    "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance",
)  # fmt: skip
_NOT_STATED = "not stated"


class _Writer:
    """Elements one after another, each inside the one that is open."""

    def __init__(self) -> None:
        self.root = ElementTree.Element(
            f"{{{_DCC}}}digitalCalibrationCertificate",
            {
                "schemaVersion": VERSION,
                f"{{{_XSI}}}schemaLocation": f"{_DCC} {_DCC}/v{VERSION}/dcc.xsd",
            },
        )
        self._open = [self.root]

    @contextmanager
    def inside(self, name: str, **attributes: str) -> Iterator[None]:
        """What is written in the block lies in a new element."""
        self._open.append(ElementTree.SubElement(self._open[-1], _tag(name), attributes))
        yield
        self._open.pop()

    def leaf(self, name: str, text: str, **attributes: str) -> None:
        """An element of text."""
        ElementTree.SubElement(self._open[-1], _tag(name), attributes).text = one_line(text)

    def text(self, name: str, *contents: str) -> None:
        """An element of the schema's `textType` or `richContentType`, in English."""
        with self.inside(name):
            for content in contents:
                self.leaf("content", content or _NOT_STATED, lang="en")


def _tag(name: str) -> str:
    return f"{{{_SI}}}{name[3:]}" if name.startswith("si:") else f"{{{_DCC}}}{name}"


def write_dcc(protocol: Protocol, folder: Path) -> None:
    """Write the certificate."""
    write_atomically(folder / "dcc.xml", dcc(protocol))


def dcc(protocol: Protocol) -> bytes:
    """The certificate as XML in UTF-8."""
    for prefix, space in (("dcc", _DCC), ("si", _SI), ("xsi", _XSI)):
        ElementTree.register_namespace(prefix, space)
    writer = _Writer()
    with writer.inside("administrativeData"):
        _software(writer, protocol)
        _core(writer, protocol)
        _items(writer, protocol)
        _people(writer, protocol)
        _statements(writer, protocol)
    with writer.inside("measurementResults"):
        for name in calibrated_triads(protocol.calibration):
            own = [r for r in protocol.results if r.name.startswith(f"{name}.")]
            if own:
                _results(writer, protocol, name, own)
    ElementTree.indent(writer.root, " ")
    return ElementTree.tostring(writer.root, encoding="utf-8", xml_declaration=True) + b"\n"


# Who, what, where ---------------------------------------------------------------------------------


def _software(writer: _Writer, protocol: Protocol) -> None:
    with writer.inside("dccSoftware"):
        for name, release in protocol.software.items():
            with writer.inside("software"):
                writer.text("name", name)
                writer.leaf("release", release)


def _core(writer: _Writer, protocol: Protocol) -> None:
    station, record = protocol.station.station, protocol.record
    day = record.created[:10]
    with writer.inside("coreData"):
        writer.leaf("countryCodeISO3166_1", station.country or "ZZ")
        writer.leaf("usedLangCodeISO639_1", "en")
        writer.leaf("mandatoryLangCodeISO639_1", "en")
        writer.leaf("uniqueIdentifier", protocol.certificate)
        if station.order:
            with writer.inside("identifications"):
                _identification(writer, "calibrationLaboratory", station.order, "order")
        # Where neither the station nor the recordings' clock says the days, they were calibrated on this one.
        begin, end = protocol.days
        writer.leaf("beginPerformanceDate", begin or day)
        writer.leaf("endPerformanceDate", end or day)
        writer.leaf("performanceLocation", "laboratory")


def _identification(writer: _Writer, issuer: str, value: str, name: str) -> None:
    with writer.inside("identification"):
        writer.leaf("issuer", issuer)
        writer.leaf("value", value)
        writer.text("name", name)


def _items(writer: _Writer, protocol: Protocol) -> None:
    device, item = protocol.calibration.device, protocol.station.device
    with writer.inside("items"), writer.inside("item"):
        writer.text("name", "inertial measurement unit")
        with writer.inside("manufacturer"):
            writer.text("name", item.manufacturer)
        if item.model:
            writer.leaf("model", item.model)
        with writer.inside("identifications"):
            _identification(writer, "manufacturer", device or _NOT_STATED, "serial number")


def _people(writer: _Writer, protocol: Protocol) -> None:
    station = protocol.station.station
    with writer.inside("calibrationLaboratory"):
        _contact(writer, "contact", station.name, station.email, station.address)
    with writer.inside("respPersons"), writer.inside("respPerson"):
        with writer.inside("person"):
            writer.text("name", station.operator)
        writer.leaf("mainSigner", "true")
    _contact(writer, "customer", station.customer, "", "")


def _contact(writer: _Writer, kind: str, name: str, email: str, address: str) -> None:
    with writer.inside(kind):
        writer.text("name", name)
        writer.leaf("eMail", email or _NOT_STATED)
        with writer.inside("location"):
            writer.text("further", address)


def _statements(writer: _Writer, protocol: Protocol) -> None:
    with writer.inside("statements"):
        with writer.inside("statement"):
            writer.leaf("traceable", "false")
            writer.text("declaration", DISCLAIMER)
        if protocol.not_known:
            with writer.inside("statement"):
                writer.text("declaration", *(f"Not known: {n}" for n in protocol.not_known))
        if protocol.deviations or protocol.left_out:
            said = [f"Deviation: {d}" for d in protocol.deviations]
            said += [f"Left out: {t}" for t in protocol.left_out]
            with writer.inside("statement"):
                writer.text("declaration", *said)
        for file in protocol.record.inputs:
            with writer.inside("statement"):
                writer.text(
                    "declaration",
                    f"Input {file.file}, {file.bytes} bytes, SHA-256 {file.sha256}",
                )
        for requirement in protocol.requirements:
            _requirement(writer, requirement)


def _requirement(writer: _Writer, requirement: Requirement) -> None:
    with writer.inside("statement"):
        writer.leaf("norm", "JCGM 106:2012")
        said = f"{requirement.name} within {requirement.text}: {requirement.decision}"
        if requirement.without:
            said += f"; on the parameters alone, without {', '.join(requirement.without)}"
        writer.text("declaration", said)
        if requirement.decision != "undecided":
            writer.leaf("conformity", requirement.decision)


# What was measured --------------------------------------------------------------------------------


def _results(writer: _Writer, protocol: Protocol, name: str, own: list[Result]) -> None:
    triad = calibrated_triads(protocol.calibration)[name]
    with writer.inside("measurementResult"):
        writer.text("name", TRIAD_NAMES[name])
        with writer.inside("usedMethods"), writer.inside("usedMethod"):
            writer.text("name", f"estimator {triad.estimator}")
            writer.text(
                "description", f"Least squares ({protocol.record.method}); see protocol.json"
            )
            writer.leaf("norm", "JCGM 100:2008")
        with writer.inside("influenceConditions"):
            _condition(writer, "reference g", protocol.record.station.gravity, "m/s^2")
            known = protocol.record.conditions.temperature_range
            for which, value in zip(("lowest", "highest"), known or (), strict=False):
                _condition(writer, f"{which} temperature of the device", value, "degC")
        with writer.inside("results"):
            for at in dict.fromkeys(r.at for r in own):
                _at_one_temperature(writer, protocol, at, [r for r in own if r.at == at])
            beside = [e for e in protocol.effects if e.channels[0].startswith(f"{name}_")]
            if beside:
                _effects(writer, beside, protocol.record.station.gravity)


def _condition(writer: _Writer, name: str, value: float, unit: str) -> None:
    with writer.inside("influenceCondition"):
        writer.text("name", name)
        with writer.inside("data"), writer.inside("quantity"), writer.inside("si:real"):
            writer.leaf("si:value", repr(float(value)))
            writer.leaf("si:unit", in_si(unit, 1.0).text)


def _effects(writer: _Writer, effects: list[EffectResult], gravity: float) -> None:
    with writer.inside("result"):
        writer.text("name", "Named effects, fitted beside the parameters")
        with writer.inside("data"):
            for e in effects:
                what = ", ".join(t for t in (e.parameter, e.term) if t)
                name = f"{e.effect} on {', '.join(e.channels)} ({what})"
                _real(writer, name, e.value, e.unit, gravity, e.expanded, e.coverage_factor)


def _at_one_temperature(
    writer: _Writer, protocol: Protocol, at: float | None, results: list[Result]
) -> None:
    with writer.inside("result"):
        where = "" if at is None else f" at {at:.2f} degrees Celsius"
        writer.text("name", f"Parameters{where}")
        with writer.inside("data"):
            for result in results:
                _quantity(writer, result, protocol.record.station.gravity)


def _quantity(writer: _Writer, result: Result, gravity: float) -> None:
    name = f"{label(result.name)} ({result.name})"
    _real(
        writer, name, result.value, result.unit, gravity, result.expanded, result.coverage_factor,
        "Student t" if math.isfinite(result.degrees) else "normal",
    )  # fmt: skip


def _real(
    writer: _Writer,
    name: str,
    value: float,
    unit: str,
    gravity: float,
    expanded: float | None,
    factor: float,
    distribution: str = "normal",
) -> None:
    """A number with its expanded uncertainty, where that is known; both in `unit`."""
    si = in_si(unit, gravity)
    with writer.inside("quantity"):
        writer.text("name", name)
        with writer.inside("si:real"):
            writer.leaf("si:value", repr(si.factor * value))
            writer.leaf("si:unit", si.text)
            if expanded is not None:
                with writer.inside("si:expandedUnc"):
                    writer.leaf("si:uncertainty", repr(si.factor * expanded))
                    writer.leaf("si:coverageFactor", f"{factor:.6f}")
                    writer.leaf("si:coverageProbability", f"{COVERAGE:g}")
                    writer.leaf("si:distribution", distribution)
