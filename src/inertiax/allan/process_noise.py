"""The noise of a triad as numbers that a digital twin or a navigation filter takes, in SI units.

    output = truth + white noise N + slow bias b(t) + rate of a random walk K,     b: Gauss–Markov for B

Flicker noise has no finite state; the usual stand-in is a first-order Gauss–Markov process of standard deviation σ
and correlation time T, ḃ = −b/T + σ √(2/T) w. Its Allan deviation is greatest at τ = 1.893 T, where it is
0.6174 σ; here that is the flicker's 0.6643 B, at the middle (in log τ) of the averaging times where flicker prevails.

**Reference:** IEEE Std 952-1997, annex C.1.1.3 and C.2.2.
"""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Bool, Float

from .._records import Module
from ..data.json_documents import decode
from .model import FLICKER, NoiseModel


SCHEMA = "inertiax.noise/1"
# Of a first-order Gauss–Markov process: where its Allan deviation is greatest, in correlation times, and how great,
# in standard deviations.
_PEAK_TIME, _PEAK = 1.8926, 0.6174


class TriadNoise(Module):
    """Noise of three axes; a term that the log can do without is zero, and `determined` says which the log tells.

    For a filter, which should not trust its sensor too much, `cautious` puts the 95 % limits there.
    """

    white: Float[np.ndarray, "3"]  # N, (m/s²)/√Hz or (rad/s)/√Hz, two-sided density
    instability: Float[np.ndarray, "3"]  # B, m/s² or rad/s
    walk: Float[np.ndarray, "3"]  # K, m/s²/√s or rad/s/√s
    ramp: Float[np.ndarray, "3"]  # R, m/s³ or rad/s²
    quantisation: Float[np.ndarray, "3"]  # Q, m/s or rad
    # s, of the Gauss–Markov process for B; infinite where B is zero
    correlation_time: Float[np.ndarray, "3"]
    # Hz, the sensor's low-pass (−3 dB); infinite where none was seen
    bandwidth: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]  # Hz, of the sensor's own samples
    duration: float  # s, of the log: of slower changes it tells nothing
    # 95 % limits in the order N, B, K, R, Q; infinite where there is none
    upper: Float[np.ndarray, "5 3"]
    determined: Bool[np.ndarray, "5 3"]  # in the same order

    @property
    def markov_std(self) -> Float[np.ndarray, "3"]:
        """Standard deviation of the Gauss–Markov process that stands for B, in the unit of B."""
        return np.sqrt(FLICKER) / _PEAK * self.instability

    @property
    def cautious(self) -> "TriadNoise":
        """The same with the 95 % limits for terms that are not determined, where there is a limit."""
        chosen = np.isfinite(self.upper) & ~self.determined
        terms = {
            name: np.where(chosen[k], self.upper[k], getattr(self, name))
            for k, name in enumerate(("white", "instability", "walk", "ramp", "quantisation"))
        }
        time = correlation_time(terms["white"], terms["instability"], terms["walk"], self.duration)
        return replace(self, **terms, correlation_time=time)


def correlation_time(
    white: Float[np.ndarray, "3"],
    instability: Float[np.ndarray, "3"],
    walk: Float[np.ndarray, "3"],
    duration: float,
) -> Float[np.ndarray, "3"]:
    """Correlation time of the Gauss–Markov process that stands for B, s; infinite where B is zero.

    Flicker prevails from τ = N² / (0.441 B²) to 3 · 0.441 B² / K², or to the log's length where that comes first.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = FLICKER * np.square(instability)
        begins = np.square(white) / floor
        ends = np.minimum(3.0 * floor / np.square(walk), duration)
        middle = np.sqrt(begins * np.maximum(ends, begins))
    return np.where(instability > 0.0, middle / _PEAK_TIME, np.inf)


def triad_noise(models: tuple[NoiseModel, NoiseModel, NoiseModel]) -> TriadNoise:
    """The noise of a triad from the models of its axes x, y and z."""
    order = ("N", "B", "K", "R", "Q")
    terms = [[m.terms[name] for m in models] for name in order]
    known = [np.array([t.known for t in row]) for row in terms]
    bandwidth = [np.inf if m.corner is None else m.corner for m in models]
    duration = min(m.duration for m in models)
    return TriadNoise(
        *known,
        correlation_time=correlation_time(known[0], known[1], known[2], duration),
        bandwidth=np.array(bandwidth),
        rate=np.array([m.rate for m in models]),
        duration=duration,
        upper=np.array([[t.upper for t in row] for row in terms]),
        determined=np.array([[t.shown for t in row] for row in terms]),
    )


# From a file -----------------------------------------------------------------------------------------


class _Value(msgspec.Struct):
    value: float | None


class _Term(msgspec.Struct):
    value: float | None
    upper_95: float | None
    least: float = 0.0


class _Channel(msgspec.Struct):
    terms: dict[str, _Term]
    rate: _Value
    filter_corner: _Value


class _Log(msgspec.Struct):
    device: str
    duration: _Value
    channels: dict[str, _Channel]


class _Document(msgspec.Struct):
    schema: str
    logs: list[_Log]


def read_triad_noise(path: Path, triad: str, *, device: str | None = None) -> TriadNoise:
    """The noise of a triad ("accel" or "gyro") from the `noise.json` that `inertiax noise` writes.

    Where the document holds several logs, `device` says which. Raises `ValueError` for another document, and where
    the device's log or one of the axes is missing.
    """
    document = decode(
        path.read_bytes(), _Document, str(path), "a document of `inertiax noise`", SCHEMA
    )
    logs = [log for log in document.logs if device is None or log.device == device]
    if len(logs) != 1:
        raise ValueError(
            f"{path}: {len(logs)} of {len(document.logs)} logs are of "
            f"{'any device' if device is None else repr(device)}; one is needed."
        )
    axes = [logs[0].channels.get(f"{triad}_{a}") for a in "xyz"]
    if any(axis is None for axis in axes):
        raise ValueError(
            f"{path}: {triad}_x, {triad}_y and {triad}_z are needed; the log has "
            f"{', '.join(logs[0].channels)[:80]}."
        )
    return _of_document(logs[0], [axis for axis in axes if axis is not None])


def _of_document(log: _Log, axes: list[_Channel]) -> TriadNoise:
    order = ("N", "B", "K", "R", "Q")
    terms = [[axis.terms.get(name, _Term(None, None)) for axis in axes] for name in order]
    known = [np.array([t.value or t.least for t in row]) for row in terms]
    limit = lambda value: np.inf if value is None else value
    duration = log.duration.value or 0.0
    return TriadNoise(
        *known,
        correlation_time=correlation_time(known[0], known[1], known[2], duration),
        bandwidth=np.array([limit(axis.filter_corner.value) for axis in axes]),
        rate=np.array([axis.rate.value or 0.0 for axis in axes]),
        duration=duration,
        upper=np.array([[limit(t.upper_95) for t in row] for row in terms]),
        determined=np.array([[t.value is not None for t in row] for row in terms]),
    )
