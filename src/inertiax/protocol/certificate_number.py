"""The number of a certificate: no two have the same unless their station, device, inputs and results are the same."""

import hashlib
import re
from collections.abc import Sequence
from typing import Any

import msgspec

from .record import Record
from .station import Station


_DIGITS = 12  # hexadecimal: two of a million certificates of one order and serial number agree with a chance of 0.2 %


def certificate_number(
    station: Station, device: str, record: Record, stated: Sequence[dict[str, Any]]
) -> str:
    """The station's own number, or order and serial number with a digest of inputs and statements.

    The same whenever the same is stated of the same files, at any time and on any machine.

    **Arguments:** `device` is the serial number, empty where there is none; `stated` are results, requirements and
    whatever else the certificate states, in the form of its JSON.
    """
    said = station.station
    if said.certificate:
        return said.certificate
    content = (
        msgspec.to_builtins(station),
        device,
        sorted(f.sha256 for f in record.inputs),
        record.calibration_sha256 if not record.inputs else "",
        list(stated),
    )
    digest = hashlib.sha256(msgspec.json.encode(content, order="deterministic")).hexdigest()
    parts = (said.order or "inertiax", device or "no-serial", digest[:_DIGITS])
    # Spaces and the like would be lost or folded where numbers are compared.
    return "-".join(re.sub(r"[^\w.+-]+", "_", part) for part in parts)
