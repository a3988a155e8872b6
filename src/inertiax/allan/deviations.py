"""The Allan family of deviations of a rate log, in running sums.

A log of rates y (rad/s, m/s², …) at one sampling rate integrates to a phase x; with τ = m / rate each
deviation is the root of a mean square of differences of x:

    adev, oadev     x[i+2m] − 2 x[i+m] + x[i]                  stride m; every i
    mdev, tdev      the same averaged over m neighbours; tdev = τ mdev / √3
    hdev, ohdev     x[i+3m] − 3 x[i+2m] + 3 x[i+m] − x[i]      stride m; every i
    totdev          as oadev, the phase extended at both ends by its inverted reflection
    mtotdev, ttotdev  as mdev on every 3m samples, levelled and extended by reflection

Deviations have the unit of the rates; tdev and ttotdev that unit times second. Work goes in blocks that
stay in the processor's cache, which is what makes ten million samples quick.

**Reference:** Riley, *Handbook of frequency stability analysis*, NIST SP 1065 (2008), sections 5.2 to 5.13.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from .._records import field, Module
from .stored_channel import BLOCK, Log


_BLOCK = 1 << 13  # samples of a block: its arrays fit a core's cache
_TOTAL_BLOCK = 1 << 20  # numbers of a block of extended sequences

_Phase = Float[np.ndarray, " phase"]


class Deviations(Module):
    """A deviation over averaging times; where fewer than two differences exist there is no row."""

    kind: str = field(static=True)
    rate: float = field(static=True)  # Hz
    num_samples: int = field(static=True)  # of the log
    factor: Int[np.ndarray, " tau"]  # m, samples averaged
    tau: Float[np.ndarray, " tau"]  # s
    deviation: Float[np.ndarray, " tau"]  # unit of the log (tdev, ttotdev: times s)
    count: Int[np.ndarray, " tau"]  # differences that were averaged


def deviations(
    log: Float[np.ndarray, " time"],
    *,
    rate: float,
    kind: str = "oadev",
    factors: Int[np.ndarray, " tau"] | None = None,
) -> Deviations:
    """One of the deviations `KINDS` of a log at constant sampling `rate`, Hz.

    `factors` are the averaging factors m (τ = m / rate), about eight an octave where not given.
    Raises `ValueError` where the log is too short, not finite, or the kind unknown.
    """
    if kind not in KINDS:
        raise ValueError(f"`deviations(kind={kind!r})`: kind must be one of {sorted(KINDS)}.")
    log = np.asarray(log, float)
    if log.ndim != 1 or len(log) < 8 or not np.all(np.isfinite(log)):
        raise ValueError(
            f"`deviations(log)`: a log of 8 or more finite samples is needed, got shape {log.shape}."
        )
    if not rate > 0:
        raise ValueError(f"`deviations(rate={rate!r})`: the sampling rate must be positive, in Hz.")
    spans, mean_square = KINDS[kind]
    chosen = usual_factors(len(log)) if factors is None else np.unique(np.asarray(factors, int))
    chosen = chosen[(chosen >= 1) & (spans * chosen <= len(log))]
    phase = _phase(log, rate)
    found = [mean_square(phase, int(m)) for m in chosen]
    count = np.array([n for _, n in found], int)
    kept = count >= 2
    chosen, tau = chosen[kept], chosen[kept] / rate
    squares = np.array([s for s, _ in found])[kept]
    deviation = np.sqrt(squares / 2.0) / tau
    if kind in ("hdev", "ohdev"):
        deviation /= np.sqrt(3.0)
    if kind in ("tdev", "ttotdev"):
        deviation *= tau / np.sqrt(3.0)
    return Deviations(kind, rate, len(log), chosen, tau, deviation, count[kept])


def short_deviations(log: Log, *, rate: float, factors: Int[np.ndarray, " tau"]) -> Deviations:
    """`oadev` at averaging factors far below a log's length, which is read in pieces.

    A difference of the phase is the same whatever line is taken from it, so each piece's phase begins anew.
    """
    reach, squares = 2 * int(factors[-1]), np.zeros(len(factors))
    counts = len(log) + 1 - 2 * factors  # differences: each begins at a phase of its own
    for first in range(0, len(log), BLOCK):
        phase = _phase(log[first : first + BLOCK - 1 + reach], rate)
        for k, m in enumerate(factors):
            begin = min(int(counts[k]) - first, BLOCK)
            squares[k] += _sum_squares(begin, partial(_second, phase, int(m)))
    tau = factors / rate
    deviation = np.sqrt(squares / counts / 2.0) / tau
    return Deviations("oadev", rate, len(log), factors, tau, deviation, counts)


def _phase(log: Float[np.ndarray, " time"], rate: float) -> _Phase:
    """The running sum of the log less its mean; in place, for it is as long as the log."""
    phase = np.zeros(len(log) + 1)
    np.subtract(log, log.mean(), out=phase[1:])
    np.cumsum(phase[1:], out=phase[1:])
    phase /= rate
    return phase


def usual_factors(samples: int) -> Int[np.ndarray, " tau"]:
    """Averaging factors from 1 to a third of the log, about eight an octave."""
    longest = max(samples // 3, 1)
    grid = 2.0 ** (np.arange(0, 8 * np.log2(longest) + 1) / 8)
    return np.unique(grid.round().astype(int))


def _blocks(count: int, length: int) -> Iterator[tuple[int, int]]:
    for start in range(0, count, length):
        yield start, min(start + length, count)


def _sum_squares(count: int, term: Callable[[int, int], np.ndarray], length: int = _BLOCK) -> float:
    # Not `np.dot`: starting BLAS' threads would take longer than the sum.
    parts = (term(a, b) for a, b in _blocks(count, length))
    return float(sum(np.einsum("i,i", v, v) for v in parts))


def _second(phase: _Phase, m: int, a: int, b: int) -> np.ndarray:
    v = phase[a + 2 * m : b + 2 * m] + phase[a:b]
    middle = phase[a + m : b + m]
    v -= middle
    v -= middle
    return v


def _overlapping(phase: _Phase, m: int) -> tuple[float, int]:
    count = len(phase) - 2 * m
    return _sum_squares(count, lambda a, b: _second(phase, m, a, b)) / count, count


def _every_mth(phase: _Phase, m: int) -> tuple[float, int]:
    v = np.diff(phase[::m], n=2)
    return float(np.mean(np.square(v))), len(v)


def _overlapping_hadamard(phase: _Phase, m: int) -> tuple[float, int]:
    count = len(phase) - 3 * m

    def third(a: int, b: int) -> np.ndarray:
        v = phase[a + m : b + m] - phase[a + 2 * m : b + 2 * m]
        v *= 3.0
        v += phase[a + 3 * m : b + 3 * m]
        v -= phase[a:b]
        return v

    if count < 1:
        return np.nan, count
    return _sum_squares(count, third) / count, count


def _every_mth_hadamard(phase: _Phase, m: int) -> tuple[float, int]:
    v = np.diff(phase[::m], n=3)
    return (float(np.mean(np.square(v))) if len(v) else np.nan), len(v)


def _modified(phase: _Phase, m: int) -> tuple[float, int]:
    count = len(phase) - 3 * m + 1
    if count < 1:
        return np.nan, count

    def averaged(a: int, b: int) -> np.ndarray:
        # Sums that start anew in each block: one over the whole log would lose digits.
        total = np.cumsum(_second(phase, m, a, b + m - 1))
        v = total[m - 1 :].copy()
        v[1:] -= total[: b - a - 1]
        return v

    return _sum_squares(count, averaged, _BLOCK + 4 * m) / count / m**2, count


def _total(phase: _Phase, m: int) -> tuple[float, int]:
    before = 2.0 * phase[0] - phase[m:0:-1]
    after = 2.0 * phase[-1] - phase[-2 : -m - 2 : -1]
    extended = np.concatenate([before, phase, after])
    # The first and the last sample are centres of differences that vanish identically.
    inner = extended[1:-1]
    count = len(phase) - 2
    return _sum_squares(count, lambda a, b: _second(inner, m, a, b)) / count, count


def _modified_total(phase: _Phase, m: int) -> tuple[float, int]:
    count = len(phase) - 3 * m + 1
    if count < 1:
        return np.nan, count
    windows = np.lib.stride_tricks.sliding_window_view(phase, 3 * m)
    half = 3 * m // 2
    apart = 3 * m - half  # samples between the middles of both halves
    squares = 0.0
    for a, b in _blocks(count, max(_TOTAL_BLOCK // (9 * m), 1)):
        part = windows[a:b]
        slope = (part[:, -half:].mean(axis=1) - part[:, :half].mean(axis=1)) / apart
        level = part - part[:, :1] - slope[:, None] * np.arange(3 * m)
        flipped = level[:, ::-1]
        total = np.cumsum(np.hstack([np.zeros((b - a, 1)), flipped, level, flipped]), axis=1)
        sums = total[:, m:] - total[:, :-m]
        v = sums[:, : 6 * m] - 2.0 * sums[:, m : 7 * m] + sums[:, 2 * m : 8 * m]
        squares += float(np.sum(np.square(v)))
    return squares / (6.0 * m**3) / count, count


# Samples that one difference spans, in units of m, and the mean square of the differences.
KINDS: dict[str, tuple[int, Callable[[_Phase, int], tuple[float, int]]]] = {
    "adev": (2, _every_mth),
    "oadev": (2, _overlapping),
    "mdev": (3, _modified),
    "tdev": (3, _modified),
    "hdev": (3, _every_mth_hadamard),
    "ohdev": (3, _overlapping_hadamard),
    "totdev": (1, _total),
    "mtotdev": (3, _modified_total),
    "ttotdev": (3, _modified_total),
}
