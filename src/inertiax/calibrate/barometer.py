"""A barometer over temperature, from a recording at one height: a polynomial of degree five at most, as PX4 takes it.

    p'(t) = p₀ + B(T(t)) + d t,   B(T_ref) = 0

The weather changes the pressure while the device warms, by tens of pascals an hour. Where the temperature goes up and
down, a drift d that is linear in time is told apart and taken away; where it goes one way only, it is not, and a
warning says how much weather the result would hold. Recordings without a common clock have a p₀ each and no drift.
Averages over stretches of time are fitted, and what is left of them resembles its neighbours, which the covariance
takes into account.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._records import field, Module
from ..calibration.barometer import BarometerCalibration
from ..data.recording import Recording
from ..model_selection.model_spec import LEAST_SPAN
from ..model_selection.temperature_degree import temperature_levels
from ..physics.temperature import Curve, Polynomial


HIGHEST = 5  # of PX4's polynomial
LOWEST_PRESSURE, HIGHEST_PRESSURE = 30e3, 120e3  # Pa: the top of Everest, the Dead Sea with margin
STRETCHES = 200  # averages that are fitted: fewer than samples, many more than unknowns
# Of the drift's column, beside the polynomial's: below, temperature goes one way as time does (convention).
_SEPARATE = 0.1
_WEATHER = 50.0  # Pa an hour, of a passing front (100 Pa an hour is a storm)


class BarometerResult(Module):
    """A barometer's calibration, what was left of the averages, and words about it."""

    calibration: BarometerCalibration
    rms: float = field(static=True)  # Pa, of the averages that were fitted
    drift: float | None = field(static=True)  # Pa/s; None: not told apart from temperature
    statements: tuple[str, ...] = field(static=True)
    warnings: tuple[str, ...] = field(static=True)
    temperature: Float[np.ndarray, " row"]  # °C, of the averages
    offset: Float[
        np.ndarray, " row"
    ]  # Pa: the averages less place and drift, zero at the reference temperature


def barometer_beside(
    recordings: Sequence[Recording],
) -> tuple[BarometerResult | None, tuple[str, ...]]:
    """The barometer over temperature where both were recorded beside the triads, and what to say of it."""
    if any(r.pressure is None or r.temperature is None for r in recordings):
        return None, ()
    try:
        found = calibrate_barometer(recordings)
    except ValueError as error:
        return None, (f"the barometer is not calibrated: {error}",)
    return found, found.warnings


def calibrate_barometer(recordings: Sequence[Recording]) -> BarometerResult:
    """A barometer over temperature from one device's recordings.

    The degree is chosen by the Bayesian information criterion, as those of the triads. Raises `ValueError` where there
    is no temperature, or too little of it, or the pressure is none in Pa.
    """
    time, temperature, pressure, owner = _stretches(recordings)
    if not LOWEST_PRESSURE < float(np.median(pressure)) < HIGHEST_PRESSURE:
        raise ValueError(
            f"pressure: the median is {np.median(pressure):.6g}, and the atmosphere's is about 101325 Pa; say the "
            'unit: [columns] pressure = { unit = "hPa" }.'
        )
    low, high = float(temperature.min()), float(temperature.max())
    if high - low < LEAST_SPAN:
        raise ValueError(f"pressure: the temperature moves by {high - low:.2f} °C only.")
    hours = (time - time.mean()) / 3600.0
    most = max(min(HIGHEST, temperature_levels(temperature) - 1, (len(time) - 3) // 2), 1)
    polynomial = lambda degree: Polynomial(degree, low, high).rows(temperature)
    one_clock = bool(np.all(np.diff(time) > 0.0))
    separate = one_clock and _is_separate(polynomial(most), hours)
    beside = hours[:, None] if separate else np.zeros((len(time), 0))
    if not one_clock:
        beside = (owner[:, None] == np.arange(1, owner.max() + 1)).astype(float)
    designs = {d: np.column_stack([polynomial(d), beside]) for d in range(1, most + 1)}
    degree = min(designs, key=lambda d: _score(designs[d], pressure))
    design = designs[degree]
    solution, *_ = np.linalg.lstsq(design, pressure, rcond=None)
    left = pressure - design @ solution
    spread = _covariance(design, left)
    size = degree + 1
    reference = 0.5 * (low + high)
    made = BarometerCalibration(
        Curve(Polynomial(degree, low, high), _without_mean(solution[:size], reference, low, high)),
        spread[:size, :size],
        reference,
    )
    rms = float(np.sqrt(np.mean(np.square(left))))
    drift = float(solution[size]) / 3600.0 if separate else None
    told, warnings = _words(made, degree, rms, drift, float(np.ptp(hours)), (low, high))
    offset = made.over(temperature)[0] + left
    return BarometerResult(made, rms, drift, told, warnings, temperature, offset)


def _stretches(
    recordings: Sequence[Recording],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Averages of time (s), temperature (°C) and pressure (Pa) over stretches of rows; number of the recording."""
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for recording in recordings:
        if recording.pressure is None or recording.temperature is None:
            continue
        read = np.isfinite(recording.pressure)
        if read.any():
            columns = (
                recording.time[read], recording.temperature[read, 0], recording.pressure[read]
            )  # fmt: skip
            parts.append(columns)
    if not parts:
        raise ValueError("pressure: there is no temperature beside it.")
    total = sum(len(p[0]) for p in parts)
    found = []
    for number, columns in enumerate(parts):
        count = max(1, min(len(columns[0]), STRETCHES * len(columns[0]) // total))
        edges = np.linspace(0, len(columns[0]), count + 1).astype(int)[:-1]
        sizes = np.diff(np.append(edges, len(columns[0])))
        means = [np.add.reduceat(c, edges) / sizes for c in columns]
        found.append([*means, np.full(count, number)])
    time, temperature, pressure, owner = (np.concatenate(c) for c in zip(*found, strict=True))
    return time, temperature, pressure, owner


def _is_separate(columns: Float[np.ndarray, "row unknown"], hours: np.ndarray) -> bool:
    """Whether time is more than a function of temperature."""
    solution, *_ = np.linalg.lstsq(columns, hours, rcond=None)
    return bool(np.std(hours - columns @ solution) > _SEPARATE * np.std(hours))


def _score(design: Float[np.ndarray, "row unknown"], values: np.ndarray) -> float:
    """BIC = n ln(RSS/n) + k ln n."""
    solution, *_ = np.linalg.lstsq(design, values, rcond=None)
    n, k = design.shape
    rss = float(np.sum(np.square(values - design @ solution)))
    return n * math.log(max(rss, 1e-300) / n) + k * math.log(n)


def _covariance(
    design: Float[np.ndarray, "row unknown"], left: Float[np.ndarray, " row"]
) -> Float[np.ndarray, "unknown unknown"]:
    """s² τ (XᵀX)⁻¹, with τ = 1 + 2 Σ ρ_h of what is left, over correlations beyond chance."""
    n, k = design.shape
    square, total = float(left @ left), 1.0
    for lag in range(1, n // 4 if square > 0.0 else 1):
        correlation = float(left[:-lag] @ left[lag:]) / square
        if correlation < 2.0 / math.sqrt(n):
            break
        total += 2.0 * correlation
    return square / max(n - k * total, 1.0) * total * np.linalg.inv(design.T @ design)


def _without_mean(
    solution: Float[np.ndarray, " size"], reference: float, low: float, high: float
) -> Float[np.ndarray, "size 1"]:
    """The curve less its value at the reference temperature, which is the pressure of the place."""
    coefficients = solution.copy()
    basis = Polynomial(len(solution) - 1, low, high)
    coefficients[0] -= float((basis.rows(np.array([reference])) @ solution)[0])
    return coefficients[:, None]


def _words(
    made: BarometerCalibration,
    degree: int,
    rms: float,
    drift: float | None,
    hours: float,
    ends: tuple[float, float],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    offsets, sigmas = made.over(np.linspace(*ends, 25))
    told = (
        f"barometer: degree {degree} over {ends[0]:.1f} to {ends[1]:.1f} °C by BIC, {np.ptp(offsets):.3g} Pa from "
        f"least to greatest (1 sigma {np.max(sigmas):.2g} Pa at most), {rms:.2g} Pa rms left"
    )
    if drift is not None:
        return (f"{told}; a drift of {3600.0 * drift:.3g} Pa/h was taken away",), ()
    weather = _WEATHER * hours
    return (told,), (
        f"barometer: weather is not told from temperature: {_WEATHER:g} Pa/h would be {weather:.2g} Pa over the "
        "recording; warm and cool the device in one log, or record a second barometer",
    )
