"""Who measured what, where and when: what a protocol says of it, and what nobody stated."""

from ..report.page import Section, Table
from .protocol import Protocol


JUDGED = "by the rule of inertiax calibrate, see Deviations where it is not good"
_UNNAMED = "not named; [device] serial in campaign.toml or in the station's file names it"


def identity(protocol: Protocol) -> Section:
    """Who, what, where, when, with what."""
    station, record = protocol.station.station, protocol.record
    days = _measured(protocol)
    if days and not (station.begin or station.end):
        days += ", by the recordings' clock (UTC)"
    rows = [
        ("certificate", protocol.certificate),
        *(_named(protocol) | {"device": protocol.calibration.device or _UNNAMED}).items(),
        ("customer, order", ", ".join(t for t in (station.customer, station.order) if t)),
        ("measured", days),
        ("calibrated", f"{readable(record.created)} with inertiax {record.software['inertiax']}"),
        ("command", record.command),
        ("fit", f"{record.verdict}, {JUDGED}"),
    ]
    shown = tuple((name, text or "not stated") for name, text in rows)
    return Section("Identity", tables=(Table(("", "stated"), shown),))


def not_stated(protocol: Protocol) -> str | None:
    """What a reader of the protocol looks for and nobody stated, with the file that states it; `None`: all is there."""
    lacking = [name for name, text in _named(protocol).items() if not text]
    if not _measured(protocol):
        lacking.append("days of the measurement")
    if not lacking:
        return None
    return (
        f"Not stated: {'; '.join(lacking)}. --station FILE states them in [station] and [device]."
    )


def readable(moment: str) -> str:
    """A moment of ISO 8601 for people."""
    return moment.replace("T", " ").replace("Z", " UTC")


def _named(protocol: Protocol) -> dict[str, str]:
    """Device, station and operator, each empty where nobody states it."""
    station, item = protocol.station.station, protocol.station.device
    return {
        "device": protocol.calibration.device,
        "manufacturer, model": ", ".join(t for t in (item.manufacturer, item.model) if t),
        "station": ", ".join(t for t in (station.name, station.address, station.country) if t),
        "operator": station.operator,
    }


def _measured(protocol: Protocol) -> str:
    """First and last day."""
    return " to ".join(dict.fromkeys(d for d in protocol.days if d))
