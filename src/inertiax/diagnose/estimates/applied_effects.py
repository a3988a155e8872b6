"""The augmented model at work: named effects taken away from a recording, or put on ideal inputs.

An effect e acts on the outputs and depends on what the device goes through, a' = (E + Γ) a + a⁰ + e(a, …), so
compensation is the fixed point

    a ← (E + Γ)⁻¹ (a' − a⁰ − e(a, …)),

which contracts by the size of ∂e/∂a: a thousandth or less for every effect of a usable sensor. A dead band does not:
within it ∂e/∂a = −1, and each step would add the noise once more. There the output tells nothing of the input, and
nothing is taken away.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ..._jax import eqx, jax
from ..._typing import AnyArray
from ...calibration.calibration import Calibration, TriadCalibration
from ...calibration.fitted_effects import FittedEffect, known_effect
from ...calibration.over_rows import compensated_rows, distorted_rows, row_parameters
from ...data.recording import Campaign, Recording
from ...effects import addition, CATALOGUE, Effect, Signal, Variant
from ...physics.temperature import Constant, Polynomial
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..observations.blocks import cut, join, Log
from ..observations.signals import (
    _moves as moves,
    _vibration as rest_vibration,
    room_axes,
    since,
    since_anew,
    smooth_temperature,
)
from ..problem import Prepared
from ..selection.score_test import whiten_system
from .common_size import held_to_common_size


ITERATIONS = 12
_HALF_NORMAL = 0.6745  # median of a Gaussian's absolute value, sigmas
_SIGMAS = 4.0  # of the noise: of as many as a million samples some sixty pass for a rate
SETTLED = 1e-10  # change of the additions, relative to the largest output, at which iteration stops


class Outputs(eqx.Module):
    """Both triads along a recording, and the effects that could not be computed for it, with reasons."""

    accel: Float[np.ndarray, "time 3"] | None  # m/s²
    gyro: Float[np.ndarray, "time 3"] | None  # rad/s
    notes: tuple[str, ...] = eqx.field(static=True, default=())


class OutputsAt(eqx.Module):
    """What a calibrated triad would put out along known inputs at other temperatures."""

    calibration: Calibration
    triad: str = eqx.field(static=True)
    force: Float[AnyArray, "time 3"]  # m/s²
    rate: Float[AnyArray, "time 3"]  # rad/s

    def __call__(self, temperature: Float[AnyArray, " time"]) -> Float[np.ndarray, "time 3"]:
        accel, gyro = distorted_rows(
            self.calibration, *map(np.asarray, (self.force, self.rate, temperature))
        )
        return accel if self.triad == "accel" else gyro


def compensate(
    calibration: Calibration, recording: Recording, *, effects: Sequence[Effect] = CATALOGUE
) -> Outputs:
    """Specific force (m/s²) and rate (rad/s) of a recording with the named effects taken away too.

    **Arguments:** `effects` is the catalogue in which `calibration.effects` are looked up by name.
    **Returns** `Outputs`; its `notes` name each effect that the recording does not let compute.
    Raises `ValueError` for an effect that the catalogue lacks.
    """
    log, usable, notes = _setting(calibration, recording, effects)
    zeros = np.zeros((len(log.time), 3))
    accel = zeros if log.accel is None else log.accel
    gyro = zeros if log.gyro is None else log.gyro
    temperature = np.zeros(len(zeros)) if log.temperature is None else log.temperature
    added = np.zeros_like(zeros), np.zeros_like(zeros)
    force, rate = compensated_rows(calibration, accel, gyro, temperature)
    course = Course(calibration, log)
    flat = {"accel": _is_noise(force), "gyro": _is_noise(rate)}
    for _ in range(ITERATIONS if usable else 0):
        now = course.additions(usable, force, rate, flat)
        change = [np.abs(n - b).max() for n, b in zip(now, added)]
        added = now
        force, rate = compensated_rows(calibration, accel - added[0], gyro - added[1], temperature)
        largest = np.abs(accel).max(), np.abs(gyro).max()
        if all(c <= SETTLED * m for c, m in zip(change, largest)):
            break
    return Outputs(None if log.accel is None else force, None if log.gyro is None else rate, notes)


def simulate(
    calibration: Calibration, inputs: Recording, *, effects: Sequence[Effect] = CATALOGUE
) -> Outputs:
    """What the device would put out, named effects included, for ideal inputs.

    **Arguments:** `inputs` holds the specific force (m/s²) in `accel` and the absolute rate (rad/s) in `gyro`,
    with temperature and positions as they would be recorded. **Returns** `Outputs`, the inverse of
    `compensate` but for noise. Raises `ValueError` for an effect that the catalogue lacks.
    """
    log, usable, notes = _setting(calibration, inputs, effects)
    zeros = np.zeros((len(log.time), 3))
    force = zeros if log.accel is None else log.accel
    rate = zeros if log.gyro is None else log.gyro
    temperature = np.zeros(len(zeros)) if log.temperature is None else log.temperature
    accel, gyro = distorted_rows(calibration, force, rate, temperature)
    added = Course(calibration, log).additions(usable, force, rate)
    return Outputs(
        None if log.accel is None else accel + added[0],
        None if log.gyro is None else gyro + added[1],
        notes,
    )


Usable = list[tuple[FittedEffect, Effect]]


def _setting(
    calibration: Calibration, recording: Recording, catalogue: Sequence[Effect]
) -> tuple[Log, Usable, tuple[str, ...]]:
    """The recording as a log, the effects that it lets compute, and a line for each other."""
    effects = [
        known_effect(e.name, f"calibration: effect {e.name!r}", catalogue)
        for e in calibration.effects
    ]
    log = _log(recording, any(effect.wants_rests for effect in effects))
    course = Course(calibration, log)
    usable, notes = [], []
    for fitted, effect in zip(calibration.effects, effects):
        why = course.obstacle(fitted, effect)
        channels = ", ".join(fitted.channel_names)
        if why:
            notes.append(f"{fitted.name} on {channels} is not taken into account: {why}")
            continue
        usable.append((fitted, effect))
        if effect.clocked and course.outside(fitted):
            notes.append(
                f"{fitted.name} on {channels}: the recording's clock is outside that of the diagnosed "
                f"ones, so its value at their nearer end is taken"
            )
    return log, usable, tuple(notes)


def _log(recording: Recording, rests: bool) -> Log:
    """The recording as the diagnosis reads it; rests are only looked for where an effect wants them."""
    if not rests and recording.position is None:
        recording = eqx.tree_at(
            lambda r: r.position, recording, np.zeros(recording.num_samples, int),
            is_leaf=lambda x: x is None,
        )  # fmt: skip
    return join(Campaign((recording,)), handling=rests)


class Course(eqx.Module):
    """A recording's circumstances, from which the signal of either triad is made."""

    calibration: Calibration
    log: Log

    def obstacle(self, fitted: FittedEffect, effect: Effect) -> str:
        """Why the effect cannot be computed for this recording, or an empty text."""
        if effect.common:
            return "it belongs to the test station, not to the device"
        if effect.lost:
            return effect.lost
        if effect.clocked and fitted.clock is None:
            return "the diagnosed recordings have no common clock"
        if getattr(self.log, fitted.triad) is None:
            return f"the recording has no {fitted.triad} columns"
        if effect.wants_rests and not (self.log.position >= 0).any():
            return "the recording has no rest"
        signal = self.signal(fitted.triad, *(np.zeros((len(self.log.time), 3)),) * 2)
        lacking = [k for k in effect.requires if getattr(signal, k) is None]
        if lacking:
            return f"the recording does not tell {', '.join(lacking)}"
        if "room" in effect.requires and not signal.oriented:
            return "the recording does not tell north and up"
        return ""

    def outside(self, fitted: FittedEffect) -> bool:
        """Whether the recording's clock leaves that of the recordings that the effect was fitted on."""
        if fitted.clock is None:
            return True
        return bool(self.log.clock[0] < fitted.clock[0] or self.log.clock[-1] > fitted.clock[1])

    def additions(
        self,
        usable: Usable,
        force: np.ndarray,
        rate: np.ndarray,
        flat: Mapping[str, Bool[np.ndarray, "time 3"]] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the effects add to the accelerometers' and the gyros' outputs at these inputs.

        `flat` are samples of either triad in which an effect that is flat at zero adds nothing that is known."""
        added = {"accel": np.zeros_like(force), "gyro": np.zeros_like(rate)}
        for triad in ("accel", "gyro"):
            mine = [u for u in usable if u[0].triad == triad]
            if not mine:
                continue
            signal = self.signal(triad, force, rate)
            for fitted, effect in mine:
                own = within(signal, fitted, effect, float(self.log.clock[0]))
                count = len(np.asarray(fitted.coefficients))
                coefficients = np.zeros((3, count))
                coefficients[list(fitted.channels)] = np.asarray(fitted.coefficients)
                variant = Variant("", fitted.plain_settings)
                made = np.asarray(addition(effect, coefficients, variant, own))[1:-3]
                if effect.flat_at_zero and flat is not None:
                    made = np.where(flat[triad], 0.0, made)
                added[triad] += made
        return added["accel"], added["gyro"]

    def signal(self, triad: str, force: np.ndarray, rate: np.ndarray) -> Signal:
        """The signal of one triad for given specific force (m/s²) and rate (rad/s)."""
        log, calibration = self.log, self.calibration
        gravity = float(calibration.gravity)
        known = calibration.accel if triad == "accel" else calibration.gyro
        given = force / gravity if triad == "accel" else rate
        value = slope = None
        if log.temperature is not None:
            value, slope = smooth_temperature(log)
        low, high, degree = _scale(known, calibration.temperature_range)
        names = {e.name for e in calibration.effects}
        felt = None if log.accel is None else force / gravity
        settled, move, vibration = self._rests(given, names)
        room, upright, oriented = None, False, False
        if "magnetic" in names and felt is not None:
            room, upright, oriented = room_axes(log, felt)
        return Signal(
            triad=triad, time=log.time, input=given, output=getattr(log, triad), since_power=log.time,
            since_start=log.time, since_move=settled, move=move, at_rest=log.position >= 0,
            temperature=value, temperature_rate=slope, force=felt,
            rate=None if log.gyro is None else rate, room=room, upright=upright, oriented=oriented, vibration=vibration,
            at_temperature=None if degree == 0 else OutputsAt(calibration, triad, force, rate),
            axes=_axes(known, 0.5 * (low + high)),
            degree=degree, low=low, high=high, supply=log.supply, since_anew=since_anew(log),
        )  # fmt: skip

    def _rests(
        self, given: np.ndarray, names: set[str]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Time since the last move (s), the move itself, and the vibration at rest (g²)."""
        log = self.log
        if not names & {"settling", "vibration_rectification"} or not (log.position >= 0).any():
            return log.time, np.zeros_like(given), None
        blocks = cut(log)
        return (
            since(log, blocks)[2],
            moves(given, blocks, len(log.time)),
            rest_vibration(log, blocks, float(self.calibration.gravity)),
        )


def _is_noise(compensated: Float[np.ndarray, "time 3"]) -> Bool[np.ndarray, "time 3"]:
    """Samples that are zero within their channel's noise, by how successive ones differ."""
    if len(compensated) < 2:
        return np.zeros(compensated.shape, bool)
    sigma = np.median(np.abs(np.diff(compensated, axis=0)), axis=0) / (_HALF_NORMAL * np.sqrt(2.0))
    return np.abs(compensated) < _SIGMAS * sigma


def _axes(triad: TriadCalibration | None, temperature: float) -> Float[np.ndarray, "3 3"] | None:
    """E + Γ or E + Θ at one temperature, °C."""
    if triad is None:
        return None
    return np.eye(3) + row_parameters(triad, np.array([temperature])).matrix[:, :, 0]


def _scale(
    triad: TriadCalibration | None, covered: tuple[float, float] | None
) -> tuple[float, float, int]:
    """Temperatures (°C) that the model's polynomials map to −1 and +1, and their degree."""
    low, high = (0.0, 1.0) if covered is None else covered
    if triad is None or isinstance(triad.curve.basis, Constant):
        return low, high, 0
    if isinstance(triad.curve.basis, Polynomial):
        basis = triad.curve.basis
        return float(basis.low), float(basis.high), basis.degree
    return low, high, triad.curve.basis.size - 1


def within(signal: Signal, fitted: FittedEffect, effect: Effect, start: float) -> Signal:
    """The signal with one row before and three rows after it that carry the extent of the fit.

    Shapes are scaled by the span of time, the range of temperature and the greatest input of the
    recordings that they were fitted on; a row at each end of those makes them the same here. An effect of the
    moment is held at the ends of its clock, one of the temperature's branch within its range. `start` is
    the recorded clock (s) at the signal's first row.
    """
    time, size = np.asarray(signal.time), len(signal.time)
    rows = np.r_[0, np.arange(size), [size - 1] * 3]

    def longer(x):
        if isinstance(x, (np.ndarray, jax.Array)) and x.ndim and x.shape[0] == size:
            return np.asarray(x)[rows]
        return x

    at = signal.at_temperature
    made = jax.tree.map(
        longer, eqx.tree_at(lambda s: s.at_temperature, signal, None, is_leaf=_none)
    )
    made = replace(made, axes=signal.axes)  # no rows, whatever their number
    if isinstance(at, OutputsAt):
        at = OutputsAt(
            at.calibration, at.triad, np.asarray(at.force)[rows], np.asarray(at.rate)[rows]
        )
        made = eqx.tree_at(lambda s: s.at_temperature, made, at, is_leaf=_none)
    time = time[rows]
    if effect.clocked and fitted.clock is not None:
        span = fitted.clock[1] - fitted.clock[0]
        time = np.clip(time + (start - fitted.clock[0]), 0.0, span)
        time[0], time[-3:] = 0.0, span
    given = np.array(made.input)
    given[-1] = np.where(given[-1] < 0.0, -1.0, 1.0) * max(
        fitted.greatest_input, float(np.abs(given[-1]).max())
    )
    made = eqx.tree_at(lambda s: (s.time, s.input), made, (time, given))
    if fitted.degree is not None and fitted.scale is not None:
        low, high = fitted.scale
        made = replace(made, degree=fitted.degree, low=low, high=high)
    if fitted.temperature is None or made.temperature is None:
        return made
    low, high = fitted.temperature
    temperature = np.array(made.temperature)
    if effect.branched:
        temperature = np.clip(temperature, low, high)
        temperature[-2], temperature[-1] = low, high
    return eqx.tree_at(lambda s: s.temperature, made, temperature)


def _none(x: object) -> bool:
    return x is None


def fitted_effects(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term]
) -> list[tuple[Term, FittedEffect]]:
    """The terms of a triad's augmented fit as they are stored, with coefficients of the joint fit."""
    signal, clock = prepared.signal, prepared.clock
    temperature = None
    if signal.temperature is not None:
        values = np.asarray(signal.temperature)
        temperature = (float(values.min()), float(values.max()))
    one_clock = bool(np.all(np.diff(clock) > 0))
    made = []
    for k, term in enumerate(terms):
        others = [*terms[:k], *terms[k + 1 :]]
        found = whiten_system(prepared.system, noise, [term], others).scores
        if not found:
            continue
        values, covariance = held_to_common_size(found[0].coefficients, found[0].covariance)
        stored = (
            FittedEffect(
                term.name, term.triad, term.channels, tuple(sorted(term.variant.settings.items())),
                values, covariance,
                term.known.unit(term.triad, term.variant.settings),
                (float(clock[0]), float(clock[-1])) if one_clock else None, temperature,
                float(np.abs(np.asarray(signal.input)).max()),
                prepared.form.degree, (prepared.form.low, prepared.form.high),
            )
        )  # fmt: skip
        made.append((term, stored))
    return made
