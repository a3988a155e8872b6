"""Lines of what a station wrote beside the outputs: references, angles, labels, and what it promises."""

from collections.abc import Sequence

import numpy as np

from .accel_unit import TriadUnit
from .gyro_unit import said_unit
from .raw_triads import RawTriads
from .references import force_unit, labels_of_positions, moving_labels, rate_unit
from .table_angles import TableAngles
from .table_log import clock_lines, TableLog
from .toml_text import Line, Table, value_text
from .upright_rate import UprightRate


_PROMISE = (
    "What the station promises, 1 sigma. Take out the # and put your numbers; without them all is taken as exact.",
    "[rig]",
    "position_uncertainty = 10.0     # arcsec, each positioning",
    "rate_uncertainty = 20.0         # ppm of the commanded rate",
    "temperature_uncertainty = 0.1   # degC",
    "level_uncertainty = 10.0        # arcsec, the base's two horizontal angles, the same all along",
    "orthogonality_uncertainty = 5.0 # arcsec, of the outer axis to the inner one, the same all along",
)
_OF_AN_OUTER_AXIS = "orthogonality_uncertainty"
_EACH, _EITHER = (
    "each positioning",
    "each positioning; or axis_uncertainty = [8.0, 6.0], outer, inner",
)
_NAMED = "The device's serial number, which calibrations and certificates then name."


def reference_force(found: RawTriads) -> list[Line]:
    """The reference of the accelerometers and the positions' labels, where the file has them."""
    log, position, names = found.log, found.roles.position, found.roles.reference_accel
    force = None
    lines: list[Line] = []
    if names is not None:
        force = np.stack([log.numbers[n] for n in names], axis=1)
        told = force_unit(force)
        if told.unit is not None:
            value = {"names": list(names), "unit": told.unit}
            lines.append(Line("reference_accel", value, told.why))
        taken = {log.names[0], *names, *(found.roles.accel or ()), *(found.roles.gyro or ())}
        position = position or labels_of_positions(log, force, taken)
    if position is None:
        return lines
    moving = [] if force is None else moving_labels(log, position, force)
    if moving:
        value = {"name": position, "moving": moving[0] if len(moving) == 1 else moving}
        why = "the label with which reference_accel is zero or empty: the table moves"
        return [*lines, Line("position", value, why)]
    return lines if position == "position" else [*lines, Line("position", position)]


def with_reference_rate(found: RawTriads, unit: TriadUnit) -> tuple[TriadUnit, list[Line]]:
    """The gyros' unit, sure where the reference agrees with what the file says, and the reference."""
    names = found.roles.reference_gyro
    if names is None or found.roles.gyro is None:
        return unit, []
    log = found.log
    reference, output = (
        np.stack([log.numbers[n] for n in triad], axis=1) for triad in (names, found.roles.gyro)
    )
    told = rate_unit(reference, output - (unit.offset or 0.0), unit.factor)
    if told.unit is None:
        return unit, []
    said = said_unit(" ".join(log.hint(n) for n in names))
    if not unit.certain and told.unit == unit.unit and "; by magnitude" in unit.why:
        unit = unit._replace(
            why=f"in the unit of reference_gyro, for {told.why}; which it is,{unit.why.split(';')[-1]}"
        )
    if not unit.certain and said_unit(found.gyro_words) == unit.unit and said in (None, told.unit):
        unit = unit._replace(why=f"as the file says; {told.why} (reference_gyro)", certain=True)
    return unit, [Line("reference_gyro", {"names": list(names), "unit": told.unit}, told.why)]


def angle_lines(found: RawTriads, angles: TableAngles) -> list[Line]:
    """The columns of a table's angles and rates, and the label that it writes while it moves."""
    names: dict[str, object] = {"names": list(angles.names), "unit": angles.unit}
    lines = [Line("table_angles", names, f"{angles.why}; the outermost axis first")]
    if angles.rates is not None:
        names = {"names": list(angles.rates), "unit": angles.rate_unit}
        why = "the rates at which the angles change"
        if len(angles.rates) < len(angles.names):
            why = "the rate of the axis that turns; where the angles change otherwise, theirs is taken"
        lines.append(Line("table_rates", names, why))
    label, moving = found.roles.position, angles.moving
    if label is not None and moving:
        value = {"name": label, "moving": moving[0] if len(moving) == 1 else moving}
        lines.append(Line("position", value, "the label with which the angles change"))
    elif label not in (None, "position"):
        lines.append(Line("position", label))
    return lines


def station_tables(
    found: RawTriads,
    angles: TableAngles | None,
    latitude: float | None,
    serial: str,
    own: Sequence[TableLog] = (),
    upright: UprightRate | None = None,
) -> tuple[Table, ...]:
    """`[table]`, and what to write under `[rig]` and `[device]`, where there is a table.

    **Arguments:** `serial` is proposed where no column names the device; `own` are logs of the table's own; `upright`
    the rate of a table that turns about the vertical alone.
    """
    tables = []
    if angles is not None:
        why = "where each axis points with all angles zero, outermost first; any turn about the vertical is as good"
        lines = [
            Line("axes", list(angles.table.axes), why),
            Line("case", list(angles.table.case), "where the device's x, y and z point then"),
        ]
        if latitude is not None:
            why = (
                "where that north points, deg clockwise of true north (of an axis called east that points to 32 deg: "
                "-58); it matters for the Earth's rate, 15 deg/h, and `inertiax check` tells it where the gyros do"
            )
            lines.append(Line("azimuth", 0.0, why, certain=False))
        lines += clock_lines(own) if own else []
        tables.append(Table("table", tuple(lines)))
    roles = found.roles
    if upright is not None:
        why = "the table's one axis, as gravity and the gyros show; the device lies on one face in each file"
        late = clock_lines(own) if own else []
        tables.append(Table("table", (Line("axes", [upright.axis], why), *late)))
    if (
        upright is not None
        or angles is not None
        or roles.reference_accel is not None
        or roles.reference_gyro is not None
    ):
        # One vertical axis has no other axis.
        outer = [line for line in _PROMISE if line.removeprefix("# ").startswith(_OF_AN_OUTER_AXIS)]
        left_out = outer if upright is not None else []
        two = angles is not None and len(angles.table.axes) == 2
        said = [line.replace(_EACH, _EITHER) if two else line for line in _PROMISE]
        tables.append(Table("rig", (), tuple(line for line in said if line not in left_out)))
        if roles.device is None:
            tables.append(
                Table("device", (), (_NAMED, "[device]", f"serial = {value_text(serial)}"))
            )
    return tuple(tables)
