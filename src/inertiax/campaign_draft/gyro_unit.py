"""The gyros' unit: by gravity's turn between rests, else by what the file says, else by magnitude."""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..reduction.clipping import THRESHOLDS
from ..reduction.gravity_turns import factors_between, GravityTurns
from .accel_unit import TriadUnit
from .column_words import RATE_UNITS, said
from .companions import Companion
from .converters import DEGREE, GYRO_SCALES, middle, nearest, rounded, whole
from .stated_scales import stated_rate_scale, StatedScale


_UNITS = {"rad/s": 1.0, "deg/s": DEGREE, "deg/h": DEGREE / 3600}
_STATED = 0.06  # of a stated scale: raw MEMS gyros are off by up to that
_ALIKE = np.deg2rad(0.3)  # of two misfits: cross-axis parts of some mrad over a right angle
_NEXT = 1.5  # times as large is another scale
_NEAR = 0.15  # of a unit or nominal scale: raw gyros are off by a few percent
_PER_MILLI = 1000.0  # per deg/s
_SCALES = (_PER_MILLI, *GYRO_SCALES)
_NEAR_SCALE = 0.05  # of a usual converter's scale: its next one is further off
_AGREES = np.deg2rad(
    10.0
)  # median misfit of directions with the right factor; others are off by the turns themselves
_MILLI = re.compile(r"\bmdps\b|_mdps|\bmdeg|milli_?deg", re.IGNORECASE)
_RAW = re.compile(
    r"lsb|raw|count|digit|(?<![a-z])adc"
)  # words beside a unit that is not the numbers'
_QUIET_DEG = 1.0  # deg/s of noise at rest, which no gyro has that is written in whole deg/s
_CLEARER = 0.5  # of the misfit of the next unit
_MOTIONS_FOR_A_SCALE = 3  # one motion's two equations are met by a wrong scale, too
# Counts per deg/s, with room on both sides of the usual converters and of whole deg/s, and of outputs of 32 bits
# (1.5e6: 2³¹ for 1400 deg/s).
_COARSEST, _FINEST, _FINEST_WIDE = 0.8, 600.0, 1.5e6
_SIXTEEN = 2.0**15  # a count beyond it is of no converter of 16 bits, as all usual scales are
_QUIET_RAD = (
    0.012  # white noise of a sample: MEMS gyros have 0.02 to 0.5 deg/s, less than 0.01 rad/s
)
_BIAS_RAD = 0.35  # rad/s, 20 deg/s: no gyro's bias
_BLOCK = 20  # rows
_RANGES = (
    125.0,
    245.0,
    250.0,
    500.0,
    1000.0,
    2000.0,
)  # deg/s, of MEMS gyros; counts of 16 bits end at 32767
_FULL_SCALES = (
    16.0,  # BNO055
    16.384,
    32.768,
    65.536,
    131.072,
)  # counts per deg/s: 16 bits for 2000 deg/s and less
# Of small outputs, in steps of a converter: how many levels, how far off, and how many of them at least.
_LEVELS, _OFF_STEP, _ON_STEPS = 12, 0.08, 0.98
_LONGEST = 1.1 * 2**15  # steps: a bias may have been taken away
_FINE_STEP, _WIDEST = (
    1.0 / 131.072,
    4400.0,
)  # deg/s: of 20 bits at 2000 deg/s, too; MEMS gyros go to 4000
_MOVES = 50.0  # times the quietest noise: the device is carried or turned
_PEAK_RAD = 15.0  # as deg/s no hand turns so slowly throughout; as rad/s few gyros go further
_SHAKEN_PEAK = 5.0  # as deg/s nothing that is shaken turns so slowly
_QUIETEST_RAD = 0.02  # rad/s; in deg/s no MEMS gyro is quieter at the rates people log


def said_unit(hint: str) -> str | None:
    """The unit of rates that words of a file name; `None` where they name none."""
    return said(RATE_UNITS, hint)


def gyro_unit(
    values: Float[np.ndarray, "time 3"],
    turns: GravityTurns | None,
    hint: str,
    in_motion: Sequence[GravityTurns] = (),
    full_scale: float | None = None,
    *,
    shaken: bool = False,
    stated: StatedScale | None = None,
    companion: Companion | None = None,
) -> TriadUnit:
    """Unit, scale and offset of gyros.

    **Arguments:** `hint` is what the file says in words of the columns; `in_motion` is how the force turns in a device
    that moves all along, or the Earth's field; `full_scale` (deg/s) is what the file says of the range; `shaken` says
    that the force's size goes to and fro as in a hand; `stated` is the scale that the file states, and `companion`
    that of a chip whose accelerometers gravity tells.
    """
    counts, offset = whole(values), middle(values) or None
    if stated is not None:  # of coarse counts there are few
        counts = bool(np.all(values == np.round(values)))
    by_scale = stated is not None and counts
    if (
        not by_scale
        and _MILLI.search(hint)
        and (turns is None or turns.misfit(DEGREE / _PER_MILLI) < _AGREES)
    ):
        scale = (_PER_MILLI, "count per deg/s", None, DEGREE / _PER_MILLI)
        return TriadUnit("count", *scale, "thousandths of deg/s, as the file says", True)
    told = said_unit(hint)
    if turns is not None:
        wide = counts and offset is None and float(np.abs(values).max()) > _SIXTEEN
        found = _by_turns(turns, counts, offset, stated, companion, wide=wide)
        if found is not None and told is None and _by_chance(turns, found, values):
            found = None
        by_name = stated_rate_scale(hint) if counts else None
        if found is not None and stated is not None and found.factor == stated.factor:
            return found
        if found is not None and by_name is not None:
            text = f"{found.why}, but the file says {by_name.text}"
            return found._replace(why=text, certain=False)
        if found is not None and told in (None, found.unit):
            return found
        if found is not None:
            return found._replace(why=f"{found.why}, but the file says {told}", certain=counts)
    missing = (
        "no motion between rests tilts the device, so gravity does not tell the unit"
        if turns is None
        else f"no unit turns the gyros as gravity turns in {turns.num_motions} motions: are axes exchanged or mirrored?"
    )
    if stated is not None and counts:
        text, certain = f"{stated.text}, as the file says; {missing}", turns is None
        scale = (stated.scale, stated.scale_unit, offset, stated.factor)
        return TriadUnit("count", *scale, text, certain)
    if told is not None and not counts:
        whether = stated_rate_scale(hint)  # a converter's step beside numbers that are no counts
        text = "as the file says" if whether is None else f"'{whether.text}' in the file's words"
        certain = turns is None and whether is None
        return TriadUnit(told, None, None, None, _UNITS[told], f"{text}; {missing}", certain)
    # Rests of a device that is carried are none, so that their turns may fail; a mirrored axis fails in motion, too.
    limit = _AGREES if turns is None else _AGREES / 2
    told_by = [] if counts else [_by_motion(m, limit) for m in in_motion]
    moving = next((u for u in told_by if u is not None), None)
    if told is not None and offset is None and not _RAW.search(hint):
        of_unit = _whole_numbers(values, told, missing, full_scale, certain=turns is None)
        if of_unit is not None:
            return of_unit
        missing = f"the file says {told}, in which no gyro turns as fast; {missing}"
    end = _end_of_range(values) if counts and told is None else None
    if end is not None:
        at = f"{end[1]} samples stand at {end[0]:g}, where a range in deg/s ends and no converter's counts do"
        text = f"{at}; {missing}"
        return TriadUnit("deg/s", None, None, None, DEGREE, text, turns is None)
    if counts and companion is not None and offset is None and told is None and not full_scale:
        scale = (companion.scale, "count per deg/s", None, DEGREE / companion.scale)
        return TriadUnit("count", *scale, f"{missing}; {companion.text}", False)
    return moving or _by_magnitude(values, counts, offset, missing, full_scale, shaken)


def _end_of_range(values: Float[np.ndarray, "time 3"]) -> tuple[float, int] | None:
    """The end of a usual range in deg/s that outputs are held at, and by how many samples; `None` where none are."""
    end = float(np.abs(values).max())
    held = int(np.sum(np.abs(values) == end))
    return (end, held) if end in _RANGES and held >= THRESHOLDS.fewest else None


def _whole_numbers(
    values: Float[np.ndarray, "time 3"],
    unit: str,
    missing: str,
    full_scale: float | None,
    *,
    certain: bool,
) -> TriadUnit | None:
    """The unit that the file says of whole numbers; `None` where no gyro, or none of `full_scale` (deg/s), turns as
    fast as they were."""
    degrees = values * (_UNITS[unit] / DEGREE)
    if float(np.abs(degrees).max()) > (full_scale or _WIDEST):
        return None
    _, quietest, zero = _noise(degrees)
    bias = float(np.abs(zero).max())
    text = f"as the file says; {missing}"
    if quietest > _QUIET_DEG or bias * DEGREE > _BIAS_RAD:
        text = (
            f"as the file says, but these may be raw counts (noise {quietest:.2g} deg/s at rest, zero up to "
            f"{bias:.2g} deg/s); {missing}"
        )
        certain = False
    return TriadUnit(unit, None, None, None, _UNITS[unit], text, certain)


def _by_chance(turns: GravityTurns, found: TriadUnit, values: Float[np.ndarray, "time 3"]) -> bool:
    """Whether so few motions tell a unit in which the zero would be no gyro's."""
    if turns.num_motions >= _MOTIONS_FOR_A_SCALE or found.unit == "count":
        return False
    return found.factor * float(np.abs(_noise(values)[2]).max()) > _BIAS_RAD


def _by_motion(turns: GravityTurns, limit: float) -> TriadUnit | None:
    """The unit by which the force turns in motion to the limit (rad), where it fits twice as well as any other and as
    none."""
    misfits = {u: turns.misfit(f) for u, f in _UNITS.items()}
    best, second = sorted(misfits, key=misfits.__getitem__)[:2]
    if misfits[best] > min(limit, _CLEARER * misfits[second], _CLEARER * turns.misfit(0.0)):
        return None
    text = (
        f"in {turns.num_motions} windows of motion the {turns.what} turns as the outputs do "
        f"(to {np.degrees(misfits[best]):.2g} deg; in {second} to {np.degrees(misfits[second]):.2g})"
    )
    return TriadUnit(best, None, None, None, _UNITS[best], text, True)


def _by_turns(
    turns: GravityTurns,
    counts: bool,
    offset: float | None,
    stated: StatedScale | None = None,
    companion: Companion | None = None,
    *,
    wide: bool = False,
) -> TriadUnit | None:
    """The unit with which the integrated outputs turn gravity as it turned; the `stated` scale where it does so
    too, and of more than 16 bits (`wide`) the scale that fits."""
    motions = f"{turns.num_motions} motion{'s' * (turns.num_motions > 1)}"
    what = lambda misfit: (
        f"gravity turns as the outputs do in {motions} (to {np.degrees(misfit):.2g} deg)"
    )
    if counts:
        finest = DEGREE / (_FINEST_WIDE if wide else _FINEST)
        factor, misfit = _fewest_turns(turns, factors_between(finest, DEGREE / _COARSEST))
    else:
        also = () if stated is None else (stated.factor,)
        factor, misfit = turns.best((*_UNITS.values(), *also))
        if misfit > _AGREES and turns.num_motions >= _MOTIONS_FOR_A_SCALE:
            factor, misfit = turns.best([DEGREE / s for s in _SCALES])
            if nearest(DEGREE / factor, _SCALES, _NEAR_SCALE) is None:
                return None
    if misfit > _AGREES:
        return None
    if stated is not None:
        near, left = turns.best((stated.factor,))
        right = abs(near / stated.factor - 1.0) < _STATED and near < _NEXT * factor
        if right and left <= misfit + _ALIKE:
            text = f"{what(left)} with {stated.text}, as the file says"
            scale = (stated.scale, stated.scale_unit, offset, stated.factor)
            return TriadUnit("count", *scale, text, True)
    unit = next((u for u, f in _UNITS.items() if abs(factor / f - 1.0) < _NEAR), None)
    if unit is not None and (not counts or unit == "deg/s"):
        return TriadUnit(unit, None, None, None, _UNITS[unit], what(misfit), True)
    per_degree = DEGREE / factor
    nominal = None
    if offset is None and not wide:
        own = () if companion is None else (companion.scale,)
        sure = companion is not None and companion.sure and nearest(per_degree, own, _NEAR_SCALE)
        nominal = nearest(per_degree, own if sure else (*own, *_SCALES), _NEAR_SCALE)
    scale = nominal or rounded(per_degree)
    text = f"{what(misfit)}; the scale that fits best is {per_degree:.4g} count per deg/s"
    several = turns.num_motions >= _MOTIONS_FOR_A_SCALE
    if companion is not None and nominal == companion.scale:
        several, text = several and companion.sure, f"{text}; {companion.text}"
    if wide:
        text = f"{text}, of more than 16 bits"
    elif nominal is None and offset is None:
        several, text = False, f"{text}, no usual converter's: is the rate of `time` right?"
    return TriadUnit("count", scale, "count per deg/s", offset, DEGREE / scale, text, several)


def _fewest_turns(
    turns: GravityTurns, factors: Float[np.ndarray, " factor"]
) -> tuple[float, float]:
    """The factor that turns gravity as it turned, and its misfit; of several that do so alike the smallest, with which
    the device turns no whole turn more between rests: 45° is also 405°."""
    factor, misfit = turns.best(factors)
    if misfit > _AGREES / 2:
        return factor, misfit
    for smaller in np.sort(factors[factors * _NEXT < factor]):
        if turns.misfit(smaller) < _AGREES:
            found, left = turns.best((float(smaller),))
            if left <= misfit + _ALIKE:
                return found, left
    return factor, misfit


def _by_magnitude(
    values: Float[np.ndarray, "time 3"],
    counts: bool,
    offset: float | None,
    missing: str,
    full_scale: float | None,
    shaken: bool,
) -> TriadUnit:
    """A guess, and said to be one."""
    if counts:
        scale = min(GYRO_SCALES, key=lambda s: abs(s - 32768.0 / (full_scale or 250.0)))
        by = "as the file says" if full_scale else "if that is its range"
        text = f"{missing}; {scale:g} counts per deg/s are the usual scale for {full_scale or 250.0:g} deg/s, {by}"
        return TriadUnit("count", scale, "count per deg/s", offset, DEGREE / scale, text, False)
    step = _converter_step(values)
    if step is not None:
        text = f"{missing}; in {step[0]} the outputs go in steps of {step[1]:.4g} deg/s, a usual converter's"
        return TriadUnit(step[0], None, None, None, _UNITS[step[0]], text, True)
    noise, quietest, zero = _noise(values)
    bias, peak = float(np.abs(zero).max()), float(np.quantile(np.abs(values - zero), 0.999))
    carried = 0.0 < quietest < min(_QUIETEST_RAD, peak / _MOVES) and peak < _PEAK_RAD
    carried |= shaken and peak < _SHAKEN_PEAK
    unit = "rad/s" if bias < _BIAS_RAD and (noise < _QUIET_RAD or carried) else "deg/s"
    of = f"rates up to {peak:.2g}, noise {quietest:.2g}" if carried else f"noise {noise:.2g}"
    text = f"{missing}; by magnitude ({of}, zero up to {bias:.2g}) likely {unit}"
    return TriadUnit(unit, None, None, None, _UNITS[unit], text, False)


def _converter_step(values: Float[np.ndarray, "time 3"]) -> tuple[str, float] | None:
    """The unit in which small outputs are whole numbers of a usual converter's steps (deg/s), where one alone fits.

    A converter of 16 bits goes no further than 32768 of its steps, one of 20 bits no further than any gyro.
    """
    found: dict[str, float] = {}
    peak = float(np.abs(values).max())
    for unit in ("rad/s", "deg/s"):
        for step in sorted((1.0 / s for s in (*GYRO_SCALES, *_FULL_SCALES)), reverse=True):
            widest = _WIDEST if step == _FINE_STEP else _LONGEST * step
            if peak * _UNITS[unit] > DEGREE * widest:
                continue
            level = values * (_UNITS[unit] / (DEGREE * step))
            level = level[np.abs(level) < _LEVELS]
            whole_ones = np.round(level)
            on = np.abs(level - whole_ones) < _OFF_STEP
            if len(np.unique(whole_ones)) > _LEVELS and np.mean(on) > _ON_STEPS:
                found[unit] = step
                break
    return next(iter(found.items())) if len(found) == 1 else None


def _noise(values: Float[np.ndarray, "time 3"]) -> tuple[float, float, Float[np.ndarray, "3"]]:
    """White noise of a sample over all rows, and over the quietest 20 of them, which a motion does not hide; and the
    zero: the median of the quieter tenth, in which the device turns least."""
    change = np.abs(np.diff(values, axis=0))
    blocks = len(change) // _BLOCK
    if not blocks:
        return 0.0, 0.0, np.median(values, axis=0)
    split = lambda x: x[: blocks * _BLOCK].reshape(blocks, _BLOCK, 3)
    block = np.median(split(change), axis=(1, 2))
    quiet = block <= np.quantile(block, 0.1)
    zero = np.median(split(values)[quiet].reshape(-1, 3), axis=0)
    # Of normal differences the median is 0.954 sigma.
    return float(np.median(change)) / 0.954, float(block.min()) / 0.954, zero


def turn_as_gravity(values: Float[np.ndarray, "time 3"], turns: GravityTurns) -> bool:
    """Whether outputs turn as gravity does, in some unit or scale and in several motions."""
    enough = turns.num_motions >= _MOTIONS_FOR_A_SCALE
    return enough and _by_turns(turns, whole(values), middle(values) or None) is not None


def clock_and_unit(
    values: Float[np.ndarray, "time 3"], turns: GravityTurns | None
) -> tuple[float, float] | None:
    """Rate (Hz) and misfit of a log without any clock, where rows are taken as seconds in `turns`.

    Gravity tells the product of factor and step alone; of the units only one gives a rate at which IMUs are read.
    """
    if turns is None:
        return None
    factors = [DEGREE / s for s in GYRO_SCALES] if whole(values) else list(_UNITS.values())[:2]
    product, misfit = turns.best(factors_between(min(factors) / 2000.0, max(factors) / 5.0))
    if misfit > _AGREES:
        return None
    rates = [f / product for f in factors]
    usual = [r for r in rates if 10.0 <= r <= 1100.0]
    return (usual[0], misfit) if len(usual) == 1 else None
