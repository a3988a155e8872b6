"""What each triad went through, from the log and the fitted models: the `Signal` that effects act on."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from ..._jax import eqx
from ..._typing import AnyArray, Scalar
from ...effects import arrays as xp, Signal
from ...effects.effect import chebyshev
from ...effects.thermal_lag import is_anew, JOINT
from ...numerics.local_parabola import local_parabola
from ...reduction.dwells import is_told
from .attitude import attitude
from .blocks import block_mean, Blocks, EARTH_RATE, Log
from .model_rows import Baseline, CalibratedTriad, compensated, ModelForm
from .vertical import upright_axis


_PAUSE_STEPS = (
    20.0  # usual steps of a pause, as `check` counts gaps: a log of few rows pauses always
)
_ROUNDING = 1e-12  # of a temperature: some thousand units in its last place
# Part of a plateau's root mean square force that its mean has where the force stands in the case: cos 6°, where it
# turns at 6° to the axis.
_STANDS = 0.995
_TOLD = 30.0  # condition of the rests' design up to which they tell the axes (convention)


class AtTemperature(eqx.Module):
    """The fitted model's outputs along the signal if the element had another temperature."""

    bias: Float[AnyArray, "3 size"]
    matrix: Float[AnyArray, "3 3 size"]  # E + Γ in its constant term
    input: Float[AnyArray, "time 3"]  # m/s² or rad/s
    low: Scalar | float
    high: Scalar | float

    def __call__(self, temperature: Float[AnyArray, " time"]) -> Float[AnyArray, "time 3"]:
        made, *others = self._parts
        for k, part in enumerate(others, 1):
            made = made + chebyshev(temperature, k, self.low, self.high) * part
        return made.T

    def change(
        self, element: Float[AnyArray, " time"], probe: Float[AnyArray, " time"]
    ) -> Float[AnyArray, "time 3"]:
        """The outputs at one temperature less those at another."""
        constant, *others = self._parts
        made = None
        for k, part in enumerate(others, 1):
            at = [chebyshev(t, k, self.low, self.high) for t in (element, probe)]
            more = (at[0] - at[1]) * part
            made = more if made is None else made + more
        return (xp.zeros_like(constant) if made is None else made).T

    @property
    def _parts(self) -> Sequence[Float[AnyArray, "3 time"]]:
        """The outputs for a unit of each polynomial; made once for all, but for those of JAX, which may be traced."""
        known = not xp.of_jax(self.input, self.bias, self.matrix)
        return self._kept_parts if known else self._made_parts()

    def _made_parts(self) -> Sequence[Float[AnyArray, "3 time"]]:
        # An axis a row: along rows of three numbers NumPy takes several times as long.
        given = xp.asarray(self.input).T
        parts = range(self.bias.shape[1])
        return [self.matrix[:, :, k] @ given + self.bias[:, k, None] for k in parts]

    @cached_property
    def _kept_parts(self) -> Sequence[Float[AnyArray, "3 time"]]:
        return self._made_parts()

    def with_parameters(
        self, base: Baseline, coefficients: Float[np.ndarray, "parameter size"]
    ) -> "AtTemperature":
        """The same for other coefficients of the fitted model."""
        changed = eqx.tree_at(lambda b: b.coefficients, base, coefficients)
        return at_temperature(changed, np.asarray(self.input))


def at_temperature(base: Baseline | CalibratedTriad, given: np.ndarray) -> AtTemperature:
    """The fitted model as a function of the element's temperature."""
    form, size = base.form, base.coefficients.shape[1]
    matrix = np.zeros((3, 3, size))
    matrix[:, :, 0] = np.eye(3)
    for k, (i, j) in enumerate(form.matrix):
        matrix[i, j] += base.coefficients[3 + k]
    return AtTemperature(base.coefficients[:3], matrix, given, form.low, form.high)


def smooth_temperature(log: Log, span: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Probe temperature and its rate by local parabolas over about `span` seconds of uninterrupted log.

    Recordings, gaps and joints, where a log goes on at another temperature, interrupt it.
    """
    assert log.temperature is not None
    value, rate = np.empty_like(log.temperature), np.empty_like(log.temperature)
    apart = np.diff(log.recording) != 0
    pause = np.diff(log.time)
    usual = np.median(pause[~apart]) if np.any(~apart) else 0.0
    apart |= (pause > span) & (pause > 5.0 * usual)  # a log of few rows pauses always
    apart |= np.abs(np.diff(log.temperature)) > JOINT
    for rows in np.split(np.arange(len(log.time)), np.flatnonzero(apart) + 1):
        t, count = log.temperature[rows], len(rows)
        step = float(np.median(np.diff(log.time[rows]))) if count > 1 else 1.0
        width = min(int(span / step) // 2 * 2 + 1, (count - 1) // 2 * 2 + 1)
        if width < 5:
            value[rows] = t
            rate[rows] = np.gradient(t, log.time[rows]) if count > 1 else 0.0
            continue
        value[rows] = local_parabola(t, width)
        wide = min(3 * width // 2 * 2 + 1, (count - 1) // 2 * 2 + 1)
        rate[rows] = local_parabola(t, wide, step)
    return value, rate


def since_pause(log: Log) -> Float[np.ndarray, " time"] | None:
    """Seconds since the last power-on, or since a pause within a recording after which elements begin anew; `None`
    where there is no such pause."""
    within = _anew(log) & (np.diff(log.recording) == 0)
    return _since(log, within | (np.diff(log.cycle) != 0)) if within.any() else None


def since_anew(log: Log) -> Float[np.ndarray, " time"] | None:
    """Seconds since the first row, or since a pause, between recordings or within one, after which elements begin anew
    (`effects.thermal_lag.is_anew`); `None` where there is no such pause."""
    anew = _anew(log)
    return _since(log, anew) if anew.any() else None


def _anew(log: Log) -> Bool[np.ndarray, " step"]:
    """Whether elements begin anew after each row but the last."""
    pause = np.diff(log.time)
    if log.temperature is None:
        return np.zeros(len(pause), bool)
    return (pause > _PAUSE_STEPS * log.step) & is_anew(pause, np.diff(log.temperature))


def _since(log: Log, begins: Bool[np.ndarray, " step"]) -> Float[np.ndarray, " time"]:
    """Seconds since the first row of each stretch, where `begins` says that another one follows a row."""
    stretch = np.cumsum(np.r_[False, begins])
    first = np.searchsorted(stretch, np.arange(stretch[-1] + 1))
    return log.time - log.time[first][stretch]


def temperature_moves(log: Log, blocks: Blocks) -> bool:
    """Whether the blocks' means differ by more than the probe's least step: less is rounding and tells nothing."""
    assert log.temperature is not None and blocks.temperature is not None
    values = np.concatenate([log.temperature[a:b] for a, b in zip(blocks.start, blocks.stop)])
    gaps = np.diff(np.unique(values))
    # What differs by rounding alone is one value.
    steps = gaps[gaps > _ROUNDING * np.abs(values).max()]
    return bool(len(steps)) and bool(np.ptp(blocks.temperature) > steps.min())


def specific_force(log: Log, blocks: Blocks, accel: CalibratedTriad | None) -> np.ndarray | None:
    """Specific force in g, one row per sample: reference, or compensated outputs, averaged over each rest.

    Without accelerometers the upright axis of a rate table tells it, where there is one.
    """
    if log.reference_accel is not None:
        return _as_stated(log, blocks, accel)
    if log.accel is None:
        return upright_axis(log)
    unit = accel is not None and accel.form.by_magnitude
    if accel is not None and unit:
        force = _compensated(log, np.arange(len(log.time)), accel)
    else:
        force = log.accel / np.median(np.linalg.norm(log.accel[blocks.start], axis=1))
    return _steady(force, blocks, ~blocks.moving, unit)


def _as_stated(log: Log, blocks: Blocks, accel: CalibratedTriad | None) -> np.ndarray:
    """The reference in g. A station may write zeros while it moves: there it is the outputs, compensated where they are
    calibrated, as the calibration takes it; of a plateau about gravity their mean."""
    assert log.reference_accel is not None  # `specific_force` saw it
    size = np.linalg.norm(log.reference_accel, axis=1)
    told = size > 0.0
    made = log.reference_accel / size[told].mean()
    if log.accel is None or told.all():
        return made
    if accel is not None:
        made[~told] = _compensated(log, np.flatnonzero(~told), accel)
    else:
        made[~told] = log.accel[~told] / np.median(np.linalg.norm(log.accel[told], axis=1))
    untold = blocks.mean(~told) > 0.0
    return _steady(made, blocks, blocks.moving & ~blocks.move & untold, False, least=_STANDS)


def _compensated(log: Log, rows: np.ndarray, accel: CalibratedTriad) -> np.ndarray:
    """Compensated outputs at some samples, in g."""
    assert log.accel is not None  # of a triad that was calibrated
    temperature = None if log.temperature is None else log.temperature[rows]
    basis = accel.form.basis(temperature, len(rows))
    return compensated(accel.form, accel.coefficients, basis, log.accel[rows]) / accel.form.gravity


def _steady(
    values: np.ndarray, blocks: Blocks, which: np.ndarray, unit: bool, least: float = 0.0
) -> np.ndarray:
    """Replace samples of each dwell of some blocks by the dwell's mean, so that noise does not enter as a regressor.

    With `unit` its size is set to 1 g: the residual of the invariant estimator must not enter either. What turns in
    the case, so that its mean is shorter than `least` of the samples' root mean square, stays as it is.
    """
    values = values.copy()
    for number in np.unique(blocks.dwell[which]):
        mine = np.flatnonzero(blocks.dwell == number)
        a, b = blocks.start[mine[0]], blocks.stop[mine[-1]]
        mean = values[a:b].mean(axis=0)
        size = np.linalg.norm(mean)
        if size >= least * np.sqrt(np.square(values[a:b]).sum(axis=1).mean()):
            values[a:b] = mean / size if unit else mean
    return values


def room_axes(log: Log, force: np.ndarray | None) -> tuple[np.ndarray | None, bool, bool]:
    """North, west and up seen by the device, `(time, 3, 3)` in columns; whether up is right, and whether all are.

    Up needs the specific force, north the Earth rate in the reference; without them the columns are
    some fixed axes of the room.
    """
    device = attitude(log, force)
    if device is None or log.reference_gyro is None:
        return None, False, False
    rest = log.position >= 0
    earth = np.einsum("tij,ti->tj", device[rest], log.reference_gyro[rest]).mean(axis=0)
    if force is None:
        return device, False, False
    up = np.einsum("tij,ti->tj", device[rest], force[rest]).mean(axis=0)
    if np.linalg.norm(up) < 0.98:
        return device, False, False  # the force does not stay in one direction of the room
    up = up / np.linalg.norm(up)
    north = earth - (earth @ up) * up
    told = np.linalg.norm(earth) >= 0.5 * EARTH_RATE  # the rests hold the Earth rate
    oriented = bool(told and np.linalg.norm(north) >= 0.1 * EARTH_RATE)
    if not oriented:  # any horizontal direction
        north = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    north = north / np.linalg.norm(north)
    return device @ np.stack([north, np.cross(up, north), up], axis=1), True, oriented


def since(log: Log, blocks: Blocks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seconds since power-on, since the first power-on and since the last re-positioning."""
    cycle = log.cycle
    begin = np.array([log.time[cycle == k][0] for k in range(cycle[-1] + 1)])
    first = np.flatnonzero(np.r_[True, np.diff(blocks.dwell) != 0])
    start = log.time[blocks.start[first]]
    # An experiment's boundary inside one pose is no re-positioning.
    moved = np.ones(len(first), bool)
    for k in range(1, len(first)):
        a, b = blocks.stop[first[k] - 1], blocks.start[first[k]]
        moved[k] = (
            bool((log.position[a:b] < 0).any())
            or blocks.position[first[k]] != blocks.position[first[k] - 1]
            or log.recording[a - 1] != log.recording[b]
        )
    start = start[moved]
    last = np.searchsorted(start, log.time, side="right") - 1
    settled = np.where(last >= 0, log.time - start[np.maximum(last, 0)], 0.0)
    return log.time - begin[cycle], log.time - log.time[0], settled


def _moves(given: np.ndarray, blocks: Blocks, rows: int) -> np.ndarray:
    """Change of the input from the rest before, one row per sample."""
    mean = block_mean(given, blocks.start, blocks.stop)
    move = np.zeros((rows, 3))
    edges = np.flatnonzero(np.r_[True, np.diff(blocks.dwell) != 0, True])
    for a, b, c in zip(edges[:-2], edges[1:-1], edges[2:]):
        move[blocks.start[b] : blocks.stop[c - 1]] = mean[b] - mean[a]
    return move


def _resolution(values: np.ndarray) -> np.ndarray:
    """Least step between different values of each output; 0 where there is no grid."""
    steps = []
    for column in values.T:
        levels = np.unique(column)
        gaps = np.diff(levels)
        step = gaps.min() if len(gaps) else 0.0
        on_grid = step > 0 and np.allclose(
            (levels - levels[0]) / step, np.round((levels - levels[0]) / step), atol=0.05
        )
        steps.append(step if on_grid and len(levels) < 0.5 * len(column) else 1e-12)
    return np.array(steps)


def axes_at_rest(
    blocks: Blocks, form: ModelForm, axes: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 3"]:
    """E + Γ of accelerometers by the rests alone, where those tell it; else the `axes` of all rows.

    Lever arms bend the calibration by all rows at rates, by a tenth of what they add there, and what they add is seen
    along the elements' axes.
    """
    if form.triad != "accel" or not form.by_reference or blocks.accel is None:
        return axes
    rest = ~blocks.moving & ~blocks.held
    force = blocks.reference_accel
    if force is None or rest.all() or not np.any(force[rest]):
        return axes
    rest &= is_told(force)
    temperature = None if blocks.temperature is None else blocks.temperature[rest]
    design = np.column_stack([force[rest], form.basis(temperature, int(rest.sum()))])
    scale = np.linalg.norm(design, axis=0)
    if len(design) <= design.shape[1] or np.linalg.cond(design / scale) > _TOLD:
        return axes
    return np.linalg.lstsq(design, blocks.accel[rest], rcond=None)[0][:3].T


def change_of_rate(log: Log, rate: Float[np.ndarray, "time 3"]) -> Float[np.ndarray, "time 3"]:
    """Derivative of the reference rate, rad/s², recording by recording; of a rest or plateau by its own rows alone.

    A station may write zeros while its table speeds up: at the ends of a plateau the reference then jumps within one
    row, by 250 rad/s² at 5 rad/s and 50 Hz, where the table turned steadily.
    """
    made = np.zeros_like(rate)
    recordings = np.flatnonzero(np.diff(log.recording, prepend=-1, append=-1))
    plain = list(zip(recordings[:-1], recordings[1:], strict=True))
    for a, b in (*plain, *zip(log.segments.start, log.segments.stop, strict=True)):
        if b - a > 2:
            made[a:b] = np.gradient(rate[a:b], log.time[a:b], axis=0)
    return made


def by_axis(values: np.ndarray) -> np.ndarray:
    """The same values, each axis's rows next to each other in memory: along rows of three numbers NumPy takes several
    times as long."""
    return np.asfortranarray(values)


def build(log: Log, blocks: Blocks, base: Baseline, force: np.ndarray | None) -> Signal:
    """The signal of one triad, sampled like the log."""
    triad, form = base.form.triad, base.form
    output = getattr(log, triad)
    rate = log.reference_gyro
    if triad == "accel":
        given = force if force is not None else np.zeros_like(output)
        physical = given * form.gravity
    else:
        given = rate if rate is not None else np.zeros_like(output)
        physical = given
    temperature = rate_t = None
    if log.temperature is not None and (form.degree > 0 or temperature_moves(log, blocks)):
        temperature, rate_t = smooth_temperature(log)
    since_power, since_start, since_move = since(log, blocks)
    resolution = _resolution(output)
    white = np.mean(getattr(blocks, f"{triad}_white") * blocks.count[:, None], axis=0)
    room, upright, oriented = room_axes(log, force)
    if room is None and len(np.unique(blocks.position)) == 1 and not blocks.moving.any():
        room, oriented = np.broadcast_to(np.eye(3), (len(log.time), 3, 3)), False
    given, physical = by_axis(given), by_axis(physical)
    model = at_temperature(base, physical)
    return Signal(
        triad=triad, time=log.time, input=given, output=by_axis(output), since_power=since_power,
        since_start=since_start, since_move=since_move, move=by_axis(_moves(given, blocks, len(log.time))),
        at_rest=log.position >= 0, temperature=temperature, temperature_rate=rate_t,
        force=None if force is None else by_axis(force), rate=None if rate is None else by_axis(rate),
        rate_change=None if rate is None else by_axis(change_of_rate(log, rate)),
        room=None if room is None else by_axis(room), supply=log.supply,
        vibration=_vibration(log, blocks, form.gravity), resolution=resolution,
        # Before rounding, which adds its own variance (Sheppard).
        scatter=np.sqrt(np.maximum(white - np.square(resolution) / 12.0, 0.0)),
        at_temperature=None if temperature is None or form.degree == 0 else model,
        axes=axes_at_rest(blocks, form, np.asarray(model.matrix)[:, :, 0]),
        expected=np.asarray(model(np.zeros(len(log.time)) if temperature is None else temperature)),
        degree=form.degree, low=form.low, high=form.high, upright=upright, oriented=oriented,
        since_pause=since_pause(log), since_anew=since_anew(log),
    )  # fmt: skip


def _vibration(log: Log, blocks: Blocks, gravity: float) -> np.ndarray | None:
    """Mean square of the specific force about each block's mean, g²; `None` where it hardly varies."""
    if log.accel is None:
        return None
    mean = block_mean(log.accel, blocks.start, blocks.stop)
    square = block_mean(log.accel**2, blocks.start, blocks.stop)
    size = np.maximum(square - mean**2, 0.0).sum(axis=1) / gravity**2
    rest = ~blocks.moving
    by_dwell = np.array([size[blocks.dwell == k].mean() for k in np.unique(blocks.dwell[rest])])
    if len(by_dwell) < 3 or by_dwell.max() < 4.0 * np.median(by_dwell):
        return None
    full = np.zeros(len(log.time))
    for a, b, k in zip(blocks.start, blocks.stop, blocks.dwell):
        full[a:b] = size[blocks.dwell == k].mean()
    return full
