"""The checks of `inertiax check` for a line: of its first devices before the run, and of some that it sets aside.

They take a tenth of a second a device, where its calibration takes some milliseconds. What is wrong with the columns or
the units of a table is wrong with all of its devices, so a few tell it.
"""

from collections.abc import Collection, Sequence

import polars as pl

from ..data.recording import Campaign
from ..plausibility import check_campaign, Finding, statements
from .one_by_one import Devices
from .reduce.tasks import Task


LOOKED_AT = 3  # devices; an error that all of them have is the line's
_TRIED = 20  # devices, of a line whose first cannot be read
_ROWS = 1_000_000  # of further devices to look at: a second a hundred thousand
_CAUSES = 5  # devices of a task of whose failures the causes are sought


def require_plausible_line(
    campaign: Campaign, tasks: Sequence[Task], devices: Devices, *, force: bool = False
) -> tuple[str, ...]:
    """What the first devices alike warn of.

    **Arguments:** `devices` gives a task's; those that cannot be read are passed over. With `force` an error is a
    warning.

    Raises `ValueError` with the statement and the remedy of the first error that all of these devices have.
    """
    found = _first(tasks, devices)
    if not found:
        return ()
    alike = [f for f in found[0] if all(any(_same(f, g) for g in other) for other in found[1:])]
    errors = [f for f in alike if f.severity == "error"]
    many = len(found)
    where = f"so in the first {many} devices" if many > 1 else "so in the first device"
    if errors and not force:
        more = f"; {len(errors) - 1} more: `inertiax check`" if len(errors) > 1 else ""
        raise ValueError(f"{campaign.path}: {errors[0].with_remedy} ({where}{more})")
    return tuple(f"{text} ({where})" for text in statements(alike))


def with_causes(
    rows: pl.DataFrame, task: Task, devices: Devices, reduced: Collection[str]
) -> pl.DataFrame:
    """The rows of the results' table with what the checks say of devices that no fit was found for, a task's first.

    **Arguments:** `reduced` are those that have dwells; why others have none is told already.
    """
    aside = rows.filter((pl.col("reason") != "") & pl.col("device").is_in(list(reduced)))
    aside = aside.get_column("device").to_list()[:_CAUSES]
    if not aside:
        return rows
    few = Task(task.number, tuple(d for d in task.devices if d[0] in aside))
    causes = {}
    for name, one in devices(few):
        errors = [] if isinstance(one, str) else check_campaign(one).of("error")
        if errors:
            causes[name] = errors[0].with_remedy.removeprefix(f"{name}: ").rstrip(".")
    known = pl.col("device").replace_strict(causes, default=None, return_dtype=pl.String)
    return rows.with_columns(reason=pl.coalesce(known, "reason")) if causes else rows


def _first(tasks: Sequence[Task], devices: Devices) -> list[tuple[Finding, ...]]:
    """The findings of each of the first devices that can be read."""
    found: list[tuple[Finding, ...]] = []
    rows = tried = 0
    for task in tasks:
        for name, own in task.devices:
            tried += 1
            for _, one in devices(Task(task.number, ((name, own),))):
                if isinstance(one, str):
                    continue
                found.append(check_campaign(one).findings)
                rows += sum(r.num_samples for r in one.recordings)
            if len(found) == LOOKED_AT or rows > _ROWS or tried == _TRIED:
                return found
    return found


def _same(one: Finding, other: Finding) -> bool:
    return (one.kind, one.severity, one.what, one.remedy) == (
        other.kind, other.severity, other.what, other.remedy,
    )  # fmt: skip
