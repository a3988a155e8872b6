"""All checks of a campaign in order, and what a command does with their findings."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

from ..data.recording import Campaign, check_given_campaign
from ..data.stored_recording import StoredRecording
from ..numerics.side_by_side import side_by_side
from ..reduction.segments import Segments
from .accel_unit import check_accel_unit
from .azimuth import check_azimuth
from .band_limit import check_band_limit
from .bench_vibration import check_bench_vibration
from .brief_rests import check_brief_rests
from .clock import check_clock
from .converter import check_converter
from .corrected_outputs import check_corrected_outputs
from .dead_channels import check_dead_channels
from .earth_shown import check_earth_shown
from .evidence import DeviceLogs, look_at
from .finding import Finding, Plausibility
from .gravity import check_gravity
from .gyro_in_motion import check_gyro_in_motion
from .gyro_rest import check_gyro_rest
from .gyro_turns import check_gyro_turns
from .idle_reference import check_idle_reference
from .interleaved_devices import check_interleaved_devices
from .latitude import check_latitude
from .mag_unit import check_mag_unit
from .moving_label import check_moving_label
from .no_rest import check_no_rest
from .other_unit import check_other_unit
from .pose_rows import check_pose_rows
from .positions import check_positions
from .processed_outputs import check_processed_outputs
from .reference import check_references
from .rests import check_rests
from .samples import (
    check_dropouts,
    check_repeated_samples,
    check_saturation,
)
from .spikes import check_spikes
from .stated_rates import check_stated_rates
from .table_delay import check_table_delay
from .temperature import check_temperature
from .thresholds import DEFAULT, Thresholds
from .zero_jump import check_zero_jump


Check = Callable[[DeviceLogs, Thresholds], list[Finding]]

# In the order in which they are told; errors come first all the same.
CHECKS: tuple[Check, ...] = (
    check_moving_label,
    check_corrected_outputs,
    check_dead_channels,
    check_pose_rows,
    check_accel_unit,
    check_mag_unit,
    check_gyro_rest,
    check_gyro_turns,
    check_gyro_in_motion,
    check_references,
    check_idle_reference,
    check_table_delay,
    check_azimuth,
    check_earth_shown,
    check_latitude,
    check_stated_rates,
    check_gravity,
    check_clock,
    check_temperature,
    check_positions,
    check_no_rest,
    check_brief_rests,
    check_rests,
    check_zero_jump,
    check_other_unit,
    check_spikes,
    check_dropouts,
    check_processed_outputs,
    check_saturation,
    check_repeated_samples,
    check_interleaved_devices,
    check_band_limit,
    check_bench_vibration,
    check_converter,
)

_ORDER = {"error": 0, "warning": 1, "note": 2}


def check_campaign(
    campaign: Campaign,
    *,
    limits: Thresholds = DEFAULT,
    as_recorded: Sequence[Segments] | None = None,
) -> Plausibility:
    """What cannot be right in a campaign, by physics alone: nothing is fitted but a few lines, on the host.

    **Arguments:** `as_recorded` are the segments of the recordings of a campaign of one device
    (`reduction.segments.segment(..., handling=False)`), where they were found before.
    """
    check_given_campaign("check_campaign(campaign)", campaign)
    found: list[Finding] = []
    for device in campaign.devices:
        logs = look_at(campaign, device, as_recorded=as_recorded)
        rows = sum(r.num_samples for r in logs.recordings)
        ask = functools.partial(_ask, logs, limits)
        for told in side_by_side(ask, CHECKS, rows=rows):
            found += _once(told, logs)
    return Plausibility(tuple(sorted(dict.fromkeys(found), key=lambda f: _ORDER[f.severity])))


def _ask(logs: DeviceLogs, limits: Thresholds, check: Check) -> list[Finding]:
    return check(logs, limits)


def _once(found: list[Finding], logs: DeviceLogs) -> list[Finding]:
    """Of what is found alike in several recordings of a device, the first, and in how many it is.

    Errors of whole recordings are told one by one, for each has its own cure; those of parts of one long log are not.
    """
    names = {log.name for log in logs.logs}
    if len(names) < 2:
        return found
    parts = {r.name: r.whole for r in logs.recordings if isinstance(r, StoredRecording)}
    alike: dict[tuple, list[Finding]] = {}
    for f in found:
        name = f.statement.split(": ", 1)[0]
        single = name not in names or (f.severity == "error" and name not in parts)
        key = (f,) if single else (f.kind, f.severity, f.what, parts.get(name))
        alike.setdefault(key, []).append(f)
    return [
        dataclasses.replace(first, statement=f"{first.statement} ({_further(others, parts)})")
        if others
        else first
        for first, *others in alike.values()
    ]


def _further(others: list[Finding], parts: dict[str, str]) -> str:
    stored = others[0].statement.split(": ", 1)[0] in parts
    what = "part" if stored else "recording"
    return f"Alike in {len(others)} further {what}{'s' * (len(others) > 1)}."


def require_plausible(
    campaign: Campaign, *, force: bool = False, as_recorded: Sequence[Segments] | None = None
) -> tuple[Finding, ...]:
    """Findings that a result has to carry: warnings and notes, and errors where `force` goes on in spite of them.

    Raises `ValueError` with the statement (and remedy) of the first error, and how many there are.
    """
    return required(campaign, check_campaign(campaign, as_recorded=as_recorded), force=force)


def required(campaign: Campaign, seen: Plausibility, *, force: bool) -> tuple[Finding, ...]:
    """`require_plausible` of a campaign that was checked before; raises as it does."""
    errors = list(seen.of("error"))
    if errors and not force:
        where = "" if campaign.path is None else f"{campaign.path}: "
        more = f" ({len(errors) - 1} more: `inertiax check`.)" if len(errors) > 1 else ""
        raise ValueError(f"{where}{errors[0].with_remedy}{more}")
    return seen.findings


def statements(findings: Sequence[Finding]) -> list[str]:
    """What a result's warnings say of findings; notes are no warnings."""
    return [f.statement for f in findings if f.severity != "note"]
