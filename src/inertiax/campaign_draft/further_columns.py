"""Columns of labels under names of their own, and columns that no line of a draft reads."""

import re

import numpy as np
from jaxtyping import Float

from .column_roles import Roles
from .column_words import plain
from .raw_triads import RawTriads
from .toml_text import Line, Table, value_text
from .upright_rate import rates_of_a_table


_READ_AS_THEY_ARE = (
    "time", "temperature", "device", "experiment", "position", "supply", "current", "pressure",
    *(f"{t}_{a}" for t in ("accel", "gyro", "mag", "reference_accel", "reference_gyro") for a in "xyz"),
)  # fmt: skip
_MOST_LABELS = 64  # different numbers: more are a measured quantity or a counter
_MOST_NAMED = 12
_LISTED_ASIDE = 4  # recordings of other lengths
_ANGLE = re.compile(r"angle|winkel|angulo|angolo")

ONE_AXIS = (
    "Of a table that turns about the vertical alone a log needs the rate as a column or as the table's own log "
    "(--table), and each mounting a file of its own: docs/how-to/turntable.md, 'One vertical axis'."
)


def columns_table(lines: tuple[Line, ...], remarks: tuple[str, ...], found: RawTriads) -> Table:
    """`[columns]` with lines for labels, and a remark on columns that no line reads.

    Of these, the ones that look like labels are told apart: text, or a few different whole numbers that stay for many
    rows.
    """
    roles, log = found.roles, found.log
    remarks = (*remarks, *roles.notes)
    if not log.has_header or log.format == "imu_tk":
        if roles.device is not None:
            remarks = (*remarks, f"{roles.device}: the device; {roles.device_by}")
        return Table("columns", lines, remarks)  # `[recordings] names` lists all of them
    lines = (*lines, *_label_lines(roles))
    read = {name for line in lines for name in _named(line.value)}
    read |= {n for note in roles.notes for n in log.names if n in note}
    names = (*log.texts, *log.stamps, *log.names)
    left = [n for n in names if n not in read and n not in _READ_AS_THEY_ARE]
    labels = [n for n in left if n in log.texts or _is_label(log.numbers.get(n))]
    others = [n for n in left if n not in labels]
    unread: tuple[str, ...] = ()
    if labels:
        what = (
            "device (serial number), experiment (one chamber setting), position (-1 while it moves)"
        )
        unread += (f"Not read, perhaps labels: {_listed(labels)}. Add what they are: {what}.",)
    told = bool({"table_angles", "table_rates"} & {line.key for line in lines})
    if not told and any(_ANGLE.search(plain(n)) for n in others):
        unread += (
            "Angles of a table make its references: [columns] table_angles, and [table] axes.",
        )
    turning = [] if roles.reference_gyro is not None else rates_of_a_table(found, others)
    if turning and not told:
        unread += (
            f"{_listed(turning)} goes with the gyros' rate as a table's does, but no angles tell how the device stood. "
            f"{ONE_AXIS}",
        )
    if others:
        unread += (f"Not read: {_listed(others)}.",)
    if again := log.names_again:
        unread += (
            f"The names stand again in line {', '.join(map(str, again))}, as where a logger was switched on again: "
            "left out.",
        )
    if aside := found.log.aside:
        more = f" and {len(aside) - _LISTED_ASIDE} more" if len(aside) > _LISTED_ASIDE else ""
        unread += (
            f"Not read, recordings of other lengths in this file: {', '.join(aside[:_LISTED_ASIDE])}{more}. A "
            "campaign.toml with their names under [columns] reads one of these instead.",
        )
    return Table("columns", lines, remarks, unread)


def _label_lines(roles: Roles) -> list[Line]:
    """Lines for devices and experiments whose columns are not called so."""
    said = (
        ("device", roles.device, roles.device_by),
        ("experiment", roles.experiment, "by its name"),
    )
    return [Line(key, name, why) for key, name, why in said if name not in (None, key)]


def _named(value: object) -> list[str]:
    if isinstance(value, dict):
        return [n for key in ("name", "names") for n in _named(value.get(key))]
    if isinstance(value, list | tuple):
        return [v for v in value if isinstance(v, str)]
    return [value] if isinstance(value, str) else []


def _is_label(values: Float[np.ndarray, " rows"] | None) -> bool:
    if values is None or not np.array_equal(values, np.round(values)):
        return False
    distinct = len(np.unique(values))
    changes = int(np.count_nonzero(np.diff(values)))
    return 1 < distinct <= _MOST_LABELS and 10 * changes <= len(values)


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(value_text(n) for n in names[:_MOST_NAMED]) + more
