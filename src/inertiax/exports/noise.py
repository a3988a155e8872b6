"""Noise figures for formats that need them, from the document that `inertiax noise` writes.

A filter has one figure per triad: the worst axis' is taken, as a filter with too small a noise trusts its sensor
too much. What a log does not determine is not exported: the user states it, knowing the 95 % limit.
"""

import math
from collections.abc import Collection, Mapping
from types import MappingProxyType, ModuleType

import msgspec

from ..data.json_documents import decode
from ..storage.wrong_value import WrongValue


SCHEMA = "inertiax.noise/1"
# Of densities and random walks; m/s³/√Hz is m/s²/√s.
_UNITS = {
    ("accel", "N"): "m/s²/√Hz",
    ("gyro", "N"): "rad/s/√Hz",
    ("accel", "K"): "m/s³/√Hz",
    ("gyro", "K"): "rad/s²/√Hz",
}


class _Value(msgspec.Struct):
    value: float
    unit: str


class _Term(msgspec.Struct):
    shown: bool
    value: float | None
    upper_95: float | None


class _Channel(msgspec.Struct):
    terms: dict[str, _Term]


class _Log(msgspec.Struct):
    device: str
    rate: _Value
    channels: dict[str, _Channel]
    topic: str | None = None


class _Document(msgspec.Struct):
    schema: str
    logs: list[_Log]


class NoiseSettings(msgspec.Struct, frozen=True):
    """Settings of a format, and a line for each figure that not all axes tell."""

    values: Mapping[str, float | int | str]
    notes: tuple[str, ...]


def settings_from_noise(
    content: bytes, module: ModuleType, device: str, given: Collection[str] = ()
) -> NoiseSettings:
    """The noise settings of an export format, SI densities, from the bytes of a `noise.json`.

    `NOISE` of its module names the format's settings with triad and term of each, `RATE` the one that takes the
    log's sampling rate. Where the document holds several logs, that of `device` is taken. Settings in `given` have a
    value of the user's own, which goes before.

    Raises `ValueError` where the format takes no noise, for another document, where a triad or the
    device's log is missing, and where the log does not determine a term that is not given.
    """
    wanted = getattr(module, "NOISE", None)
    if wanted is None:
        raise WrongValue(f"{module.NAME}: the format holds no noise figures; leave out --noise.")
    document = decode(content, _Document, "--noise", "a document of `inertiax noise`", SCHEMA)
    log = _log_of(document, device)
    values: dict[str, float | int | str] = known_settings(module, log.rate.value, log.topic)
    notes, missing = [], []
    for key, (triad, term) in wanted.items():
        if key in given:
            continue
        value, said = _worst(log, triad, term)
        if value is None:
            missing.append(f"{key} ({said})")
            continue
        values[key] = value
        if said:
            notes.append(f"{key}: {said}")
    if missing:
        raise ValueError(
            f"--noise: the log does not determine {', '.join(missing)}; state it with --set KEY=VALUE."
        )
    return NoiseSettings(values, tuple(notes))


def known_settings(
    module: ModuleType,
    rate: float | None,
    topic: str | None,
    sensor_ids: Mapping[str, int] = MappingProxyType({}),
) -> dict[str, float | int | str]:
    """What a recording itself tells of a format's settings: the sampling rate (Hz), the ROS topic and the sensors' own
    numbers, where the format has a place for them.

    Stamps tell a rate to a part in a million at best, as crystals keep it: the digits behind are of binary fractions.
    """
    rate = None if rate is None else float(f"{rate:.7g}")
    told = ((getattr(module, "RATE", None), rate), (getattr(module, "TOPIC", None), topic))
    known = {key: value for key, value in told if key is not None and value is not None}
    fields = {f.name for f in msgspec.structs.fields(module.Settings)}
    return known | {key: value for key, value in sensor_ids.items() if key in fields}


def _log_of(document: _Document, device: str) -> _Log:
    logs = document.logs
    if len(logs) > 1:
        logs = [log for log in logs if log.device == device]
    if len(logs) != 1:
        raise ValueError(
            f"--noise: {len(logs)} of {len(document.logs)} logs are of device '{device}'; one is needed."
        )
    return logs[0]


def _worst(log: _Log, triad: str, term: str) -> tuple[float | None, str]:
    """The largest figure of a triad's axes that have one, and what is to be said of the others."""
    channels = {n: c.terms for n, c in log.channels.items() if n.startswith(f"{triad}_")}
    for name, terms in channels.items():
        if term not in terms:
            raise ValueError(f"--noise: {name} has no term {term}; it has {', '.join(terms)[:60]}.")
    if not channels:
        raise ValueError(f"--noise: the log has no {triad} channels.")
    told = [t[term].value for t in channels.values() if t[term].shown]
    values = [v for v in told if v is not None and math.isfinite(v) and v > 0.0]
    if len(values) < len(told):
        raise ValueError(f"--noise: {term} of the {triad} channels is not a positive number.")
    untold = [name for name, terms in channels.items() if not terms[term].shown]
    if not values:
        return None, f"{term} of {triad}; {_limit(log, untold, term)}"
    said = f"{', '.join(untold)} do not show {term}, the other axes do" if untold else ""
    return max(values), said


def _limit(log: _Log, names: list[str], term: str) -> str:
    limits = [log.channels[n].terms[term].upper_95 for n in names]
    known = [v for v in limits if v is not None and math.isfinite(v)]
    return f"at most {max(known):.2g} at 95 %" if len(known) == len(limits) else "no limit known"


def stated_noise(
    format: str, noise: Mapping[str, tuple[str, str]], settings: object
) -> dict[str, float]:
    """The values of a format's settings of noise; `noise` is the `NOISE` of its module.

    Raises `WrongValue` for one that is not stated or not positive.
    """
    found = {}
    for key, term in noise.items():
        value = getattr(settings, key)
        if value is None or not (math.isfinite(value) and value > 0):
            raise WrongValue(
                f"{format}: {key} must be a positive number of {_UNITS[term]} (from an Allan deviation); give "
                f"--noise noise.json of `inertiax noise`, or --set {key}=..."
            )
        found[key] = float(value)
    return found
