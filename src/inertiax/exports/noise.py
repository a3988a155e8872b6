"""Noise figures for formats that need them, from the document that `inertiax noise` writes.

A filter has one figure per triad: the worst axis' is taken, as a filter with too small a noise trusts its sensor
too much. Where a log does not show random walk, its 95 % upper limit is taken, for the same reason.
"""

import math
from collections.abc import Mapping
from types import ModuleType

import msgspec

from ..data.json_documents import decode


SCHEMA = "inertiax.noise/1"


class _Value(msgspec.Struct):
    value: float
    unit: str


class _Term(msgspec.Struct):
    shown: bool
    value: float
    upper_95: float


class _Channel(msgspec.Struct):
    terms: dict[str, _Term]


class _Log(msgspec.Struct):
    device: str
    rate: _Value
    channels: dict[str, _Channel]


class _Document(msgspec.Struct):
    schema: str
    logs: list[_Log]


class NoiseSettings(msgspec.Struct, frozen=True):
    """Settings of a format, and a line for each figure that is a limit only."""

    values: Mapping[str, float]
    notes: tuple[str, ...]


def settings_from_noise(content: bytes, module: ModuleType, device: str) -> NoiseSettings:
    """The noise settings of an export format, SI densities, from the bytes of a `noise.json`.

    `module.NOISE` names the format's settings with triad and term of each, `module.RATE` the one that takes the
    log's sampling rate. Where the document holds several logs, that of `device` is taken.

    Raises `ValueError` where the format takes no noise, for another document, or where a triad or the
    device's log is missing.
    """
    wanted = getattr(module, "NOISE", None)
    if wanted is None:
        raise ValueError(f"{module.NAME}: the format holds no noise figures; leave out --noise.")
    document = decode(content, _Document, "--noise", "a document of `inertiax noise`", SCHEMA)
    log = _log_of(document, device)
    values, notes = {module.RATE: log.rate.value}, []
    for key, (triad, term) in wanted.items():
        values[key], shown = _worst(log, triad, term)
        if not shown:
            notes.append(f"{key} is an upper limit (95 %): the log does not show it")
    return NoiseSettings(values, tuple(notes))


def _log_of(document: _Document, device: str) -> _Log:
    logs = document.logs
    if len(logs) > 1:
        logs = [log for log in logs if log.device == device]
    if len(logs) != 1:
        raise ValueError(
            f"--noise: {len(logs)} of {len(document.logs)} logs are of device '{device}'; one is needed."
        )
    return logs[0]


def _worst(log: _Log, triad: str, term: str) -> tuple[float, bool]:
    """The largest figure of a triad's axes, and whether the log shows it on that axis."""
    channels = {n: c.terms for n, c in log.channels.items() if n.startswith(f"{triad}_")}
    for name, terms in channels.items():
        if term not in terms:
            raise ValueError(f"--noise: {name} has no term {term}; it has {', '.join(terms)[:60]}.")
    found = [terms[term] for terms in channels.values()]
    if not found:
        raise ValueError(f"--noise: the log has no {triad} channels.")
    value, shown = max((t.value if t.shown else t.upper_95, t.shown) for t in found)
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"--noise: the log tells no {term} of the {triad} channels.")
    return value, shown
