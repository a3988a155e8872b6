"""The whole draft: columns, units, clock and place of a log, and what could not be told."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..data.compensated import has_column, reads_compensated
from ..data.formats import ros
from ..data.formats.detect import format_of, is_recording
from ..data.pose_rows import turn_between_rows
from ..reduction.gravity_turns import GravityTurns, turns_in_motion
from ..reduction.host_stamps import USUAL_RATES
from .accel_unit import (
    accel_unit,
    lacks_gravity,
    NO_RESTS,
    OFF_GRAVITY,
    shaken,
    sphere,
    TriadUnit,
)
from .bag_topics import topic_lines
from .clock import counted
from .column_roles import roles_of, WITH_GRAVITY
from .column_words import FILES, plain
from .companions import gyro_companion
from .controller_log import correction_remarks
from .converters import ACCEL_SCALES, middle, nearest, rounded, whole
from .draft import Draft, draft_of
from .further_columns import columns_table, ONE_AXIS
from .gyro_unit import clock_and_unit, gyro_unit
from .gyros_by_turns import turns_between, with_gyros_by_turns
from .increments import as_rates, of_increments
from .joined_logs import alike, followed_by
from .mag_line import magnetometers
from .mag_unit import about_center
from .novatel_counts import of_novatel
from .or_a_field import or_a_field
from .pose_remarks import on_poses, poses_of, rests_by_both
from .raw_log import read_log
from .raw_triads import columns, RawTriads, read_triads
from .recordings_table import file_names, recordings_table, sections_file
from .resting import drifts_in_one_pose, Resting, resting
from .sensor_files import sensor_files, SensorFiles, tables_in
from .site_lines import site_of_reference, site_table
from .stated_scales import gyro_scale
from .station_lines import angle_lines, reference_force, station_tables, with_reference_rate
from .table_angles import table_angles, TableAngles
from .table_log import beside_each, column_lines, refined, refined_by_rate, TableLog
from .temperature_log import (
    column_lines as probe_columns,
    in_rows_of_its_own,
    probe_logs,
    split_off,
)
from .temperature_unit import temperature_unit
from .toml_text import CHECK, Line, Table
from .unusable_logs import refuse_folder, refuse_wrapped
from .upright_rate import upright_rate, UprightRate


_TABLES = ("csv", "imu_tk", "parquet", "hdf5", "matlab")
_ENOUGH = 1000  # samples tell where the middle of the outputs is


def draft_campaign(
    log: Path,
    folder: Path,
    *,
    gyro: Path | None = None,
    latitude: float | None = None,
    height: float = 0.0,
    others: Sequence[Path] = (),
    table: Path | Sequence[Path] | None = None,
    temperature: Path | Sequence[Path] | None = None,
) -> Draft:
    """The `campaign.toml` that fits a log, for a file in `folder`.

    **Arguments:** `others` are further recordings of the same campaign, with the same columns; `gyro` is the gyros' log
    where the triads are logged apart; without it one of that name beside an accelerometers' log is taken; `table` is
    the log that a table writes of its own, one for all logs of the device or one for each; `temperature` is that of a
    chamber or a probe, likewise, which may stand among `others`, too, if it is called so. `latitude` in deg, `height`
    in m. Of a file that `inertiax compensate` wrote the compensated columns are taken: canonical ones.

    Raises `ValueError` in one line where the log cannot be read, or holds no triad.
    """
    folder_of_logs = log.is_dir() and not is_recording(log)
    others, probed = split_off((*tables_in(log), *others) if folder_of_logs else others)
    apart = None if gyro is not None else _apart(others if folder_of_logs else (log, *others))
    if apart is not None:
        log, gyro, others = apart.accel, apart.gyro, ()
    for given in (log, *others):
        refuse_folder(given)
    probed += (temperature,) if isinstance(temperature, Path) else tuple(temperature or ())
    site = site_table(latitude, height)
    chosen = format_of(log).NAME
    tables = (table,) if isinstance(table, Path) else tuple(table or ())
    paths = file_names((log, *others), folder, one_by_one=len(tables) > 1)
    if chosen not in _TABLES and probed:
        raise ValueError(
            f"{log}: a temperature's log is put beside a table of columns, and {chosen} holds its own."
        )
    if chosen not in _TABLES:
        files = Line("files", paths, f"{chosen} names its columns and units itself")
        topics = topic_lines(log) if chosen == ros.NAME else ()
        recordings = Table("recordings", (files, *topics), unread=correction_remarks(log))
        return draft_of(log, (site, recordings))
    if all(reads_compensated(p, ()) and has_column(p, "time") for p in (log, *others)):
        why = "`inertiax compensate` wrote it: the compensated columns are taken, which have canonical names and SI"
        return draft_of(log, (site, Table("recordings", (Line("files", paths, why),))))
    found = read_triads(log, gyro)
    further = alike(found.log, others, found.roles.device)
    each = beside_each(found, further, tables) if tables else ()
    if each:
        found, further = each[0][0], tuple(one.log for one, _ in each[1:])
    own = tuple(t for _, t in each)
    found = followed_by(found, further)
    refuse_wrapped(log, found)
    rests = _rests(found)
    found = with_gyros_by_turns(found, rests)
    found, step = as_rates(found, rests)
    if step is not None:
        rests = _rests(found)
    found, turns = _with_clock(found, rests)
    angles = None if found.roles.reference_accel is not None else table_angles(found, rests)
    if angles is not None:
        own = refined(each, angles)
    probes = probe_logs(found, probed) or in_rows_of_its_own(found, (log, *others))
    # A probe's own log stands for the device's column of that name
    without = found._replace(roles=found.roles._replace(temperature=None)) if probes else found
    lines, remarks, upright = _columns(without, rests, turns, angles, own, step)
    if upright is not None:
        own = refined_by_rate(each, upright.name)
    if own and angles is None and upright is None:
        raise ValueError(
            f"{own[0].path}: no columns of it are angles of a table about which gravity in {log.name} turns, nor the "
            "rate of one that turns about the vertical. Its clock was taken to be "
            f"{own[0].clocks.delay:.1f} s late, where its columns are most like the gyros: are both logs of one run? "
            f"{ONE_AXIS}"
        )
    lines += tuple(probe_columns(probes))
    columns = columns_table(lines, remarks, found)
    if apart is not None and apart.aside:
        columns = columns._replace(unread=(*columns.unread, apart.remark))
    if found.beside is not None:
        columns = columns._replace(unread=(*columns.unread, found.beside))
    if latitude is None:
        site = site_of_reference(found) or site
    serial = _serial(log, others, tables)
    written = (
        site,
        recordings_table(found, folder, paths, own, probes),
        columns,
        *station_tables(found, angles, latitude, serial=serial, own=own, upright=upright),
    )
    return draft_of(log, (*written, _model(found, rests)))


def _serial(log: Path, others: Sequence[Path], tables: Sequence[Path]) -> str:
    """What a device is called without a column that names it: its folder, or its one file where a folder holds more."""
    folder = log.absolute().parent
    mine = {f.absolute() for f in (log, *others, *tables)}
    alone = {f for f in folder.glob(f"*{log.suffix}") if log.suffix} <= mine
    return folder.name if alone or others else log.stem


def _apart(paths: Sequence[Path]) -> SensorFiles | None:
    """The sensors' files among several; two recordings of both triads may be called after what they are for, too."""
    found = sensor_files(paths) if len(paths) > 1 else None
    if found is None or format_of(found.accel).NAME not in _TABLES:
        return None
    try:
        return found if roles_of(read_log(found.accel)).gyro is None else None
    except ValueError:
        return None


def _rests(found: RawTriads) -> Resting:
    accel = found.accel
    if accel is None:
        return resting(found.seconds, None, single_rows=False)
    centre = sphere(accel[:: -(-len(accel) // _ENOUGH)], middle(accel)).center
    single = found.roles.position is None and turn_between_rows(accel - centre) is not None
    return resting(
        found.seconds, accel, single_rows=single, centre=centre if found.gyro is None else None
    )


def _with_clock(found: RawTriads, rests: Resting) -> tuple[RawTriads, GravityTurns | None]:
    """The clock, by the gyros where the file has none, and the motions on that clock."""
    if found.clock.known or rests.single_rows:
        return found, turns_between(found, rests)
    rows = np.arange(len(found.seconds), dtype=float)
    # As a clock of one row a second: the motions may be no longer than the rows of a minute at 100 Hz.
    turns = turns_between(found, rests)
    scaled = None if turns is None else turns._replace(output=turns.output * found.clock.rate)
    told = None if found.gyro is None else clock_and_unit(found.gyro, scaled)
    if told is None:
        return found, None
    rate = nearest(told[0], USUAL_RATES, 0.01) or rounded(told[0])
    why = f"the file has no clock; gravity turns as the gyros do at {told[0]:.4g} Hz, if their scale is nominal"
    clock = counted(rate, len(found.clock.seconds), why)._replace(certain=False)
    found = found._replace(clock=clock, seconds=rows / rate)
    return found, turns_between(found, rests)


def _in_motion(found: RawTriads) -> list[GravityTurns]:
    """How the force turns in motion, and the field where the log has magnetometers in every row."""
    if found.gyro is None or not found.clock.known:
        return []
    mag = columns(found.log, found.roles.mag)
    if mag is not None and (len(mag) != len(found.seconds) or not np.isfinite(mag).all()):
        mag = None
    vectors = {
        "force": None if found.accel is None else found.accel - middle(found.accel),
        "field": None if mag is None else about_center(mag),
    }
    turns = {
        k: turns_in_motion(found.seconds, found.gyro, v)
        for k, v in vectors.items()
        if v is not None
    }
    return [t._replace(what=k) for k, t in turns.items() if t is not None]


def _columns(
    found: RawTriads,
    rests: Resting,
    turns: GravityTurns | None,
    angles: TableAngles | None,
    own: Sequence[TableLog],
    step: float | None,
) -> tuple[tuple[Line, ...], tuple[str, ...], UprightRate | None]:
    """`[columns]`, remarks on what is left to others, and the rate of a table that turns about the vertical alone;
    `step` (s) is that of increments."""
    units: dict[str, TriadUnit] = {}
    told_by_counts: tuple[TriadUnit, TriadUnit] | None = None
    lines, remarks = [] if rests.single_rows else [_time(found)], []
    named = found.log.has_header and found.log.format != "imu_tk"
    if found.accel is not None:
        if not found.accel.any():
            raise ValueError(
                f"{found.log.path}: {', '.join(found.roles.accel or ())} are zero throughout: the logger did not fill "
                "these columns. Log the accelerometers, or name other columns under [columns] in a campaign.toml."
            )
        unit = accel_unit(found.accel, rests, found.accel_words)
        told = unit.certain and (unit.scale is None or whole(found.accel))
        told = told and not (rests.turned or NO_RESTS in unit.why or OFF_GRAVITY in unit.why)
        if not told and lacks_gravity(found.accel):
            raise ValueError(
                f"{found.log.path}: {', '.join(found.roles.accel or ())} read gravity in no unit: {WITH_GRAVITY}."
            )
        unit = unit if step is None else of_increments(unit, step)
        told_by_counts = of_novatel(found, unit)
        unit = unit if told_by_counts is None else told_by_counts[0]
        units["accel"] = unit
        line = _triad("accel", found.roles.accel if named else None, unit)
        called = FILES["accel"].search(plain(found.log.path.stem))
        if found.gyro is None and not (named or called):
            doubt = or_a_field(found.accel, rests, unit)
            if doubt is not None:
                line = line._replace(why=f"{line.why}; {doubt}", certain=False)
        lines.append(line)
    if found.gyro is not None:
        moving, range_ = _in_motion(found), found.log.stated_range
        tossed = found.accel is not None and shaken(found.accel - middle(found.accel))
        words, stated = found.gyro_words, gyro_scale(found.gyro_words, found.log.preamble)
        beside = gyro_companion(units.get("accel"))
        unit = gyro_unit(
            found.gyro, turns, words, moving, range_, shaken=tossed, stated=stated, companion=beside
        )
        unit, rate = with_reference_rate(found, unit)
        unit = unit if step is None else of_increments(unit, step)
        unit = unit if told_by_counts is None else told_by_counts[1]
        units["gyro"] = unit
        lines.append(_triad("gyro", found.gyro_columns if named else None, unit))
        lines += rate
    if found.roles.mag is not None:
        told, remark = magnetometers(found, named, units.get("accel"))
        lines += told
        remarks += remark
    if rests.single_rows:
        lines.append(Line("position", {"row_index": True}, "each row is the mean of one pose"))
        lines += [line for line in reference_force(found) if line.key != "position"]
    elif angles is not None:
        lines += angle_lines(found, angles)
    else:
        lines += reference_force(found)
    referred = angles or found.roles.reference_accel or found.roles.reference_gyro
    upright = None
    if len(units) == 2 and named and not referred and not rests.single_rows:
        upright = upright_rate(found, units["accel"], units["gyro"])
    lines += [] if upright is None else [upright.line]
    lines += column_lines(own[0]) if own and (angles or upright) else []
    if found.accel is not None:
        about = None if upright is None else upright.axis
        both = rests_by_both(found, rests, units)
        said = on_poses(found, rests, both, references=angles is not None, about=about)
        remarks = [*said, *remarks]
    if found.roles.temperature is not None:
        name = found.roles.temperature
        told = temperature_unit(found.log, name, of_chip=_by_data_sheet(units.get("accel")))
        if told.unit is None:
            remarks.append(f"{CHECK} temperature: {told.why}; it is left out")
        else:
            one = found.roles.probe_of_axis
            why = f"{told.why}{'; it stands for all axes: a device has one temperature' * one}"
            several = () if one else found.roles.probes
            if several:
                why += (
                    f"; taken by its name among {', '.join(several)}: is it nearest to the sensors?"
                )
            certain = told.certain and not one and not several
            lines.append(Line("temperature", told.of_column(name), why, certain))
    return tuple(lines), tuple(remarks), upright


def _time(found: RawTriads) -> Line:
    clock = found.clock
    if clock.rate is not None:
        return Line("time", {"rate": clock.rate}, clock.why, clock.certain)
    own = found.log.has_header and found.log.format != "imu_tk"
    value: dict[str, object] = {"name": clock.name if own else "time"}
    value |= {} if found.gyro_time is None else {"gyro_name": found.gyro_time}
    value |= {} if clock.unit is None else {"unit": clock.unit}
    value |= {"mend": True} if clock.mend else {}
    return Line("time", value, clock.why, clock.certain)


def _triad(key: str, names: tuple[str, str, str] | None, unit: TriadUnit) -> Line:
    value: dict[str, object] = {} if names is None else {"names": list(names)}
    value["unit"] = unit.unit
    if unit.scale is not None:
        value |= {"scale": unit.scale, "scale_unit": unit.scale_unit}
    if unit.offset is not None:
        value["offset"] = unit.offset
    return Line(key, value, unit.why, unit.certain)


def _model(found: RawTriads, rests: Resting) -> Table:
    """The estimator that one pose allows; with more of them the tool's own choice is right."""
    if found.accel is None or sections_file(found).is_file():
        return Table("model", ())
    if rests.turned or rests.moves or poses_of(found.accel, rests) > 1:
        if found.roles.temperature is None or not drifts_in_one_pose(found.seconds, found.accel):
            return Table("model", ())
    why = "one pose tells each output's offset from its mean alone"
    return Table("model", (Line("accel_estimator", "static", why),))


def _by_data_sheet(accel: TriadUnit | None) -> bool:
    return accel is not None and accel.unit == "count" and accel.scale in ACCEL_SCALES
