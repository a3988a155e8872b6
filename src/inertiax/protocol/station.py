"""Who measured where, and what the station knows beyond its campaign: an optional TOML file.

[station]
name = "Rate table 2, hall C"
operator = "A. Example"
gravity_uncertainty = 2e-5   # m/s², 1 sigma of [site] gravity

[device]
manufacturer = "…"
model = "…"
"""

import datetime
from pathlib import Path

import msgspec

from .tables import read_tables


class StationTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[station]`; empty text where nothing is said."""

    name: str = ""
    address: str = ""
    country: str = ""  # ISO 3166-1, two letters
    email: str = ""
    operator: str = ""
    customer: str = ""
    order: str = ""  # number of the order, which several certificates may have
    certificate: str = ""  # number of this one certificate; made of order, serial number and results where not stated
    begin: str = ""  # first and last day of the measurement, YYYY-MM-DD
    end: str = ""
    gravity_uncertainty: float | None = None  # m/s², 1 sigma


class DeviceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[device]`."""

    manufacturer: str = ""
    model: str = ""
    serial: str = ""  # serial number, where the recordings and their campaign.toml state none


class Station(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file."""

    station: StationTable = StationTable()
    device: DeviceTable = DeviceTable()


def read_station(path: Path) -> Station:
    """The station of a TOML file.

    Raises `ValueError`, one line that names file and key, for unknown keys, a day or country that is none, or an
    uncertainty that is not above zero.
    """
    found = read_tables(path, Station, "[station] and [device]")
    said = found.station
    for key in ("begin", "end"):
        _require_day(path, key, getattr(said, key))
    if said.begin and said.end and said.begin > said.end:
        raise ValueError(f"{path}: [station] begin is {said.begin}, after end, {said.end}.")
    country = said.country
    if country and not (len(country) == 2 and country.isascii() and country.isupper()):
        raise ValueError(
            f"{path}: [station] country is {country!r}; write two capital letters, such as DE."
        )
    sigma = said.gravity_uncertainty
    if sigma is not None and not 0.0 < sigma < 1.0:
        raise ValueError(
            f"{path}: [station] gravity_uncertainty is {sigma:g}; it must be above 0 and below 1 m/s²."
        )
    return found


def _require_day(path: Path, key: str, day: str) -> None:
    try:
        given = datetime.date.fromisoformat(day or "2000-01-01").isoformat()
    except ValueError:
        given = ""
    if day and given != day:
        raise ValueError(f"{path}: [station] {key} is {day!r}; write a day such as 2026-01-31.")


def with_operator(station: Station, operator: str) -> Station:
    """The station with another operator."""
    said = msgspec.structs.replace(station.station, operator=operator)
    return msgspec.structs.replace(station, station=said)
