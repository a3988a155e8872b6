"""Which column is what: by its name, and in a file without names by its numbers."""

import re
from os.path import commonprefix
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from .acceleration_parts import acceleration_parts, sole_gyros
from .column_kinds import (
    are_probes,
    gravity_among_gyros,
    gyros_of_one_name,
    is_g_force,
    kind_of,
    STEADY,
    unsteadiness,
)
from .column_numbers import (
    are_whole,
    date_columns,
    is_bias_estimate,
    is_clock,
    is_clock_set_back,
    is_mark,
    is_no_output,
    rises,
    varies,
)
from .column_triads import (
    called,
    is_of_quaternion,
    is_one_array,
    left_aside,
    of_one_six,
    triads_by_name,
)
from .column_words import (
    behind_owner,
    FILES,
    FORCE_UNITS,
    is_a_rate,
    means,
    plain,
    said,
    UNIT,
    without,
)
from .converters import ACCEL_SCALES, G, nearest, whole
from .mag_unit import in_earths_field, mag_unit
from .probe_choice import ranked, rivals
from .raw_log import RawLog
from .split_stamps import is_since_1970, split_stamps
from .tagged_rows import refuse_tagged_rows
from .vectornav import vectornav


# Of columns whose names say nothing: offsets of MEMS parts are below 0.1 g, and hands that turn a device push by less.
_NEAR_GRAVITY = 1.0  # m/s²
_NEAR_ONE_G = 0.2  # relative: raw biases and scales of consumer accelerometers stay within
_NEAR_DATA_SHEET = 0.05  # relative, of counts per g
_UNIT = 1e-3  # of a quaternion's norm, as it is printed

WITH_GRAVITY = (
    "an acceleration from which an app has taken gravity tells nothing of accelerometers; take the one with gravity "
    "(Sensor Logger: TotalAcceleration; phyphox: Acceleration (with g))"
)
_LISTED = 40  # names in an error


class Roles(NamedTuple):
    """Columns by their meaning; `None` where the file has none."""

    time: str | None
    accel: tuple[str, str, str] | None
    gyro: tuple[str, str, str] | None
    temperature: str | None
    position: str | None
    notes: tuple[str, ...]  # what was left aside
    mag: tuple[str, str, str] | None = None
    reference_accel: tuple[str, str, str] | None = None  # under names of their own
    reference_gyro: tuple[str, str, str] | None = None
    mag_by: str | None = None  # why a triad without a name is taken for magnetometers
    device: str | None = None  # labels under names of their own
    device_by: str = "by its name"
    experiment: str | None = None
    unnamed: tuple[tuple[str, str, str], ...] = ()  # triads whose names say nothing
    probe_of_axis: bool = (
        False  # whether the temperature is that of the first axis, of one for each
    )
    probes: tuple[str, ...] = ()  # temperatures that may each be the device's, where several may


def roles_of(log: RawLog, only: str | None = None) -> Roles:
    """What each column is.

    **Arguments:** `only` is "accel" or "gyro" for a file of that triad alone.
    Raises `ValueError` where no triad is found.
    """
    refuse_tagged_rows(log)
    array = is_one_array(log.names) or (means("time", log.names[0]) and is_one_array(log.names[1:]))
    named = log.has_header and log.format != "imu_tk" and not array
    sentence = vectornav(log)
    if sentence is not None:
        mag, accel, gyro = map(sentence.triad, ("mag", "accel", "gyro"))
        return Roles(None, accel, gyro, sentence.temperature, None, sentence.notes, mag)
    roles = _by_name(log) if named else _by_numbers(log, only)
    if only is None:
        roles = _as_the_file_is_called(log, roles)
    if only is not None:
        first = getattr(roles, only) or roles.accel or roles.gyro
        roles = roles._replace(accel=None, gyro=None)._replace(**{only: first})
    if roles.accel is None and roles.gyro is None and roles.mag is None:
        more = f" and {len(log.names) - _LISTED} more" if len(log.names) > _LISTED else ""
        raise ValueError(
            f"{log.path.name}: no three columns x, y, z of accelerometers, gyros or magnetometers among "
            f"{list(log.names)[:_LISTED]}{more}; {_cure(log.names)}."
        )
    return roles


def _cure(names: tuple[str, ...]) -> str:
    if any(means("no_gravity", n) for n in names):
        return WITH_GRAVITY
    return "write campaign.toml by hand, with their names under [columns]"


def _as_the_file_is_called(log: RawLog, roles: Roles) -> Roles:
    """A triad alone whose columns say nothing, by the name of its file, else by its numbers."""
    triad = roles.accel
    if triad is None or roles.gyro is not None or roles.mag is not None:
        return roles
    array = is_one_array(log.names)
    if not array and any(means(k, log.hint(n)) for k in ("accel", "gyro", "mag") for n in triad):
        return _as_magnetometers(log, roles)
    called = plain(log.names[0] if array else log.path.stem)
    told = [k for k, words in FILES.items() if words.search(called)]
    if len(told) != 1:
        return _as_magnetometers(log, roles)
    if told[0] == "accel":
        return roles
    note = f"taken for the {'gyros' if told[0] == 'gyro' else 'magnetometers'}, because the file is {log.path.name}"
    if told[0] == "gyro":
        notes = (*roles.notes, f"{', '.join(triad)}: {note}")
        return roles._replace(accel=None, gyro=triad, notes=notes)
    return roles._replace(accel=None, mag=triad, mag_by=f"the file is {log.path.name}")


def _as_magnetometers(log: RawLog, roles: Roles) -> Roles:
    """A triad alone whose name says nothing, as magnetometers where its numbers are a field and no gravity.

    Whole numbers may be counts of either; so may their means, which near a data sheet's counts per g are taken for
    accelerometers' unless they read a field that is somewhere on the Earth.
    """
    triad = roles.accel
    if triad is None or roles.gyro is not None or any(means("accel", log.hint(n)) for n in triad):
        return roles
    outputs = np.stack([log.numbers[n] for n in triad], axis=1)
    outputs = outputs[np.isfinite(outputs).all(axis=1)]
    unit = None if whole(outputs) else mag_unit(outputs)
    if unit is None or any(UNIT.search(log.hint(n)) for n in triad):
        return roles
    size = float(np.median(np.linalg.norm(outputs, axis=1)))
    if any(abs(size / gravity - 1.0) < _NEAR_ONE_G for gravity in (1.0, G, 1000.0)):
        return roles
    counts = nearest(size, ACCEL_SCALES, _NEAR_DATA_SHEET)
    if counts is not None and not in_earths_field(size, unit):
        return roles
    by = (
        "no gravity in any unit" if counts is None else f"no gravity but in {counts:g} counts per g"
    )
    return roles._replace(accel=None, mag=triad, mag_by=by)


def _by_name(log: RawLog) -> Roles:
    triads = triads_by_name(log.names)
    kinds: dict[str, list[tuple[str, str, str]]] = {"accel": [], "gyro": []}
    owned: dict[str, list[tuple[str, str, str]]] = {"accel": [], "gyro": []}
    unnamed: list[tuple[str, str, str]] = []
    mags: list[tuple[str, str, str]] = []
    references: dict[str, tuple[str, str, str]] = {}
    of_axes = [t for t in triads if not is_of_quaternion(log, t) and are_probes(log, t)]
    triads = [t for t in triads if t not in of_axes and not is_of_quaternion(log, t)]
    sole = len(triads) == 1 and len(log.names) <= 4
    for triad in triads:
        first = called(triad)
        if means("mag", first) and not means("no_mag", first):
            mags.append(triad)
        reference = _reference(log, triad, first)
        if reference is not None:
            references.setdefault(reference, triad)
            continue
        if means("other", first) and not (sole and means("accel", first)):
            continue
        kind = kind_of(first, log.hint(triad[0]))
        if kind is not None:
            kinds[kind].append(triad)
            continue
        told = _by_owner(triad, first, log.hint(triad[0]))
        if told == "mag":
            mags.append(triad)
        elif told != "other":
            (unnamed if told is None else owned[told]).append(triad)
    for kind, of_owners in owned.items():  # a name that says it by itself comes first
        kinds[kind] += of_owners
    rates = [t for t in unnamed if is_a_rate(log.hint(t[0]))]
    if rates and not kinds["gyro"]:
        kinds["gyro"], unnamed = rates[:1], [t for t in unnamed if t not in rates[:1]]
    if sole and unnamed:  # nothing else to take it for
        kinds["accel"], unnamed = unnamed, []
    by_norm = [t for t in unnamed if not kinds["accel"] and _is_specific_force(log, t)]
    kinds["accel"] += by_norm[:1]
    array = [t for t in unnamed if by_norm and t not in by_norm and of_one_six(t, by_norm[0])]
    kinds["gyro"] += [] if kinds["gyro"] else array[:1]
    kinds["accel"].sort(key=lambda t: (means("no_gravity", called(t)), not is_g_force(called(t))))
    for found in kinds.values():
        found.sort(key=lambda t: _reads_nothing(log, t))
    doubled = gyros_of_one_name(log, kinds)
    notes = gravity_among_gyros(log, kinds)
    notes += [
        f"{t[0]}, {t[1]}, {t[2]}: taken for the gyros, because of those of this name it is the one without gravity"
        for t in doubled
    ]
    notes += [
        f"{t[0]}, {t[1]}, {t[2]}: taken for the accelerometers, because their norm is that of gravity"
        for t in by_norm[:1]
    ]
    notes += [left_aside(log, kind, t) for kind, found in kinds.items() for t in found[1:]]
    taken = {n for t in triads for n in t}
    free = [n for n in (*log.stamps, *log.names) if n not in taken]
    temperature = [n for n in free if means("temperature", n) and not _tells_years(log, n)]
    temperature = temperature or _t_that_is_no_time(log, free)
    temperature = ranked(log, temperature)
    times = [n for n in free if means("time", n) and n not in temperature]
    position = next((n for n in free if means("position", n) and n in log.numbers), None)
    notes += [f"{n}: a further temperature, left aside" for n in temperature[1:]]
    if not times:  # what rises throughout is a clock, whatever its name is but a counter's
        times = [n for n in free if n in log.numbers and rises(log, n) and not means("counter", n)]
        for triad in kinds["accel"][:1]:  # of several groups that of the accelerometers
            times.sort(key=lambda n: -len(commonprefix((n.rpartition("/")[0], triad[0]))))
    return Roles(
        _best_time(log, times),
        next(iter(kinds["accel"]), None),
        next(iter(kinds["gyro"]), None),
        next((n for n in temperature if n in log.numbers), None),
        position,
        tuple(notes),
        next((t for t in mags if all(n in log.numbers for n in t)), None),
        references.get("reference_accel"),
        references.get("reference_gyro"),
        device=next((n for n in (*log.texts, *free) if means("device", n)), None),
        experiment=next((n for n in free if means("experiment", n) and n in log.numbers), None),
        probe_of_axis=any(temperature[:1] == [t[0]] for t in of_axes),
        probes=rivals(log, temperature),
        unnamed=tuple(
            t for t in unnamed if t not in by_norm[:1] and all(n in log.numbers for n in t)
        ),
    )


def _by_owner(
    triad: tuple[str, str, str], first: str, hint: str
) -> Literal["accel", "gyro", "mag", "other"] | None:
    """What a triad is by what stands behind the name of its struct or device, else by the groups that it lies in
    (`ACCELEROMETER_3D/0x0268fd9f/x/v`), the inner ones first."""
    groups = [f"{plain(g)}_x" for g in reversed(triad[0].split("/")[:-1]) if len(g) > 1]
    for name in (behind_owner(first), *groups):
        if name in (first, "x"):
            continue
        if means("mag", name):
            return None if means("no_mag", first) else "mag"
        if means("other", name):
            return "other"
        kind = kind_of(name, hint)
        if kind is not None:
            return kind
    return None


def _reads_nothing(log: RawLog, triad: tuple[str, str, str]) -> bool:
    """Whether all three columns are zero or empty throughout."""
    return not any(np.nan_to_num(log.numbers[n]).any() for n in triad if n in log.numbers)


def _tells_years(log: RawLog, name: str) -> bool:
    """Whether a column of numbers holds times since 1970: the stamps in a temperature's group are called so, too."""
    return name in log.numbers and is_since_1970(log.numbers[name])


def _t_that_is_no_time(log: RawLog, free: list[str]) -> list[str]:
    """A column T beside a clock that goes up and down: a temperature."""
    ts = [n for n in free if plain(n) == "t" and n in log.numbers and not rises(log, n)]
    clock = log.stamps or any(rises(log, n) for n in free if n in log.numbers and n not in ts)
    return ts if clock else []


def _reference(log: RawLog, triad: tuple[str, str, str], first: str) -> str | None:
    """Whether a triad is a table's reference under names of its own, and which."""
    if not means("reference", first) or any(n not in log.numbers for n in triad):
        return None
    if first.lower() in ("reference_accel_x", "reference_gyro_x"):
        return None  # read as they are
    rest = without("reference", first)
    if re.search(r"mag|bias|cov|quat|euler", rest, re.IGNORECASE):
        return None
    kind = kind_of(rest, log.hint(triad[0])) if rest != "x" else None
    if kind == "gyro" or (kind is None and means("rate", rest)):
        return "reference_gyro"
    force = kind == "accel" or (rest == "x" and said(FORCE_UNITS, log.hint(triad[0])))
    return "reference_accel" if force else None


def _best_time(log: RawLog, times: list[str]) -> str | None:
    """The first column of times that increases throughout, else the first; a message's own stamp (ROS: header.stamp)
    before the time at which it was written."""
    times = sorted(times, key=lambda t: "header" not in plain(t))
    steady = [t for t in times if np.all(np.diff(_values(log, t)) > 0)]
    return next(iter(steady or times), None)


def _values(log: RawLog, name: str) -> Float[np.ndarray, " rows"]:
    return log.stamps[name] if name in log.stamps else log.numbers[name]


def _by_numbers(log: RawLog, only: str | None) -> Roles:
    """Columns without names: a clock first, then threes; the accelerometers' norm is steadier than the gyros'."""
    names = list(log.names)
    time = next(iter(log.stamps), None)
    if time is None:
        first = next((n for n in names if varies(log.numbers[n])), names[0])
        told = log.numbers[first]
        if is_clock(told) or is_since_1970(told) or is_clock_set_back(told):
            time = first
            names = names[names.index(first) + 1 :]  # what a sensor or a device is called before
    split = split_stamps(log) if time is None and log.has_header is False else None
    if split is not None:
        names = _of_message(log, [n for n in names if n not in split.columns])
    if time is not None:  # a further one, which an app writes in another form
        names = [n for n in names if not (rises(log, n) or is_since_1970(log.numbers[n]))]
    date = date_columns(log, names) if time in log.stamps else ()
    names = [n for n in names if n not in date]
    aside: list[str] = []
    while names and is_no_output(log, names):
        aside.append(names.pop(0))
    marks = [n for n in names if is_mark(log.numbers[n])]
    if not any(are_whole(log.numbers[n]) for n in names if n not in marks):
        names = [n for n in names if n not in marks]
    threes = [(names[k], names[k + 1], names[k + 2]) for k in range(0, len(names) - 2, 3)]
    notes = (
        "columns without names were told by their numbers: compare them with the logger's manual",
        *(
            f"{n}: whole numbers, left aside; where they number devices, call it 'device'"
            for n in aside
        ),
    )
    if not threes:
        return Roles(time, None, None, None, None, notes)
    if len(threes) == 2 and is_bias_estimate(log, threes[0], threes[1]):
        constant = f"{', '.join(threes.pop())}: hardly ever change, so they are the system's estimate of a bias"
        notes = (*notes, f"{constant}, left aside")
    if only is not None or len(threes) == 1:
        key = only or "accel"
        return Roles(time, None, None, None, None, notes)._replace(**{key: threes[0]})
    parts = acceleration_parts(log, threes)
    if parts is not None:
        others = tuple(t for t in threes if t not in parts)
        gyro = sole_gyros(log, others)
        added = f"{', '.join(parts.whole)}: {', '.join(parts.linear)} and {', '.join(parts.gravity)} are parts of it"
        none = "which columns are the gyros' their numbers do not tell: write gyro_x, gyro_y, gyro_z in `names`"
        notes = (*notes, f"{added}, left aside", *(() if gyro else (none,)))
        return Roles(time, parts.whole, gyro, None, None, notes, unnamed=others)
    further = next((k for k, t in enumerate(threes) if _is_specific_force(log, t)), 0)
    if further > 1:  # behind angles and fields; rates come next, if they are there at all
        gyro = threes[further + 1] if further + 1 < len(threes) else threes[further - 1]
        return Roles(time, threes[further], gyro, None, None, notes)
    first, second = threes[:2]
    if unsteadiness(log, second) < unsteadiness(log, first):
        first, second = second, first
    return Roles(time, first, second, None, None, notes)


def _of_message(log: RawLog, names: list[str]) -> list[str]:
    """A ROS message printed field by field: without covariances, which are constant, and without an attitude."""
    names = [n for n in names if np.ptp(log.numbers[n]) > 0]
    norm = np.linalg.norm([log.numbers[n] for n in names[:4]], axis=0)
    return names[4:] if len(names) > 4 and np.all(np.abs(norm - 1.0) < _UNIT) else names


def _is_specific_force(log: RawLog, triad: tuple[str, str, str]) -> bool:
    """Whether three columns have gravity's norm, m/s², nearly throughout."""
    if any(n not in log.numbers for n in triad):
        return False
    norm = np.linalg.norm([log.numbers[n] for n in triad], axis=0)
    return abs(float(np.nanmedian(norm)) - G) < _NEAR_GRAVITY and unsteadiness(log, triad) < STEADY
