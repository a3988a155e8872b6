"""Outputs against the reference columns: unit, signs and axes, single rests, the reference's gravity, remounting."""

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats.columns import AXES
from ..physics.vectors import cross_matrix
from . import remedies
from .dead_channels import is_dead
from .evidence import DeviceLogs
from .exchanged_axes import exchange_by_reference, left, ReferenceExchange, ReferenceRows
from .finding import Finding, finding
from .thresholds import Thresholds
from .turned_mount import turned_mount
from .turns import describe, IDENTITY


def check_references(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Accelerometers at rest and gyros at constant rates against their references.

    Both triads with the same axes exchanged are one finding with one remedy: the device's axes are named otherwise.
    """
    dead = [t for t in ("accel", "gyro") if is_dead(device, t, limits)]
    accel, gyro = (
        None if t in dead else exchange_by_reference(device, t, limits) for t in ("accel", "gyro")
    )
    found: list[Finding] = []
    if gyro is not None:
        found += _gyro_unit(device, gyro, limits)
    if accel is not None:
        found += _gravity(device, accel.rows, limits)
    exchanged = {
        triad: e
        for triad, e in (("gyro", gyro), ("accel", accel))
        if e is not None and e.told and e.best not in (None, IDENTITY)
    }
    if len(exchanged) == 2 and exchanged["accel"].best == exchanged["gyro"].best:
        found.append(_axes_of_both(device, exchanged["accel"], exchanged["gyro"]))
    else:
        found += [_axes(triad, device, e) for triad, e in exchanged.items()]
    if accel is not None and accel.told and "accel" not in exchanged:
        plateaus = None if gyro is None or "gyro" in exchanged else gyro.rows
        found += _accel_rests(device, accel, plateaus, limits)
    return found


def _accel_rests(
    device: DeviceLogs, accel: ReferenceExchange, plateaus: ReferenceRows | None, limits: Thresholds
) -> list[Finding]:
    if accel.best is None:
        return _disagrees(accel)
    found = _single_rests(accel.rows, device.site.gravity, limits)
    found = found or _remounted(accel.rows, limits)
    return found or turned_mount(accel.rows, plateaus, limits)


def _gyro_unit(device: DeviceLogs, gyro: ReferenceExchange, limits: Thresholds) -> list[Finding]:
    ratio, rows = gyro.ratio, gyro.rows
    if 1 / limits.accel_ratio_error < ratio < limits.accel_ratio_error:
        return []
    remedy, unit = remedies.rescaled("gyro", device.columns, 1.0 / max(ratio, 1e-300))
    said = "check the units of gyro and reference_gyro" if unit is None else f"likely {unit}"
    text = (
        f"{rows.log[0].name}: gyro reads {ratio:.4g} times reference_gyro while turning; {said} (or "
        "reference_gyro's unit is wrong)."
    )
    numbers = {"ratio": ratio, "plateaus": len(rows.log)}
    return [finding("gyro_unit", "error", "gyro", text, remedy=remedy, **numbers)]


def _axes(triad: str, device: DeviceLogs, found: ReferenceExchange) -> Finding:
    p = found.taken
    return finding(
        "axes",
        "error",
        triad,
        f"{found.rows.log[0].name}: {triad} differs from reference_{triad} by {found.given:.2f} of its size, and by "
        f"{found.misfit:.2f} when {triad} {describe(p)} (or the reference's axes are wrong).",
        remedy=remedies.exchanged(triad, device.columns, p),
        rows=len(found.rows.log),
        as_given=found.given,
        misfit=found.misfit,
        matrix=[float(v) for v in p.ravel()],
    )


def _axes_of_both(device: DeviceLogs, accel: ReferenceExchange, gyro: ReferenceExchange) -> Finding:
    p = accel.taken
    lines = [remedies.exchanged(t, device.columns, p) for t in ("accel", "gyro")]
    return finding(
        "axes",
        "error",
        "accel, gyro",
        f"{accel.rows.log[0].name}: accel and gyro differ from their references by {accel.given:.2f} and "
        f"{gyro.given:.2f} of their size, and by {accel.misfit:.2f} and {gyro.misfit:.2f} when in both "
        f"{describe(p)} (or the axes of both references are wrong).",
        remedy="\n".join([lines[0], lines[1].removeprefix("[columns]\n")]),
        rows=len(accel.rows.log) + len(gyro.rows.log),
        as_given=max(accel.given, gyro.given),
        misfit=max(accel.misfit, gyro.misfit),
        matrix=[float(v) for v in p.ravel()],
    )


def _disagrees(accel: ReferenceExchange) -> list[Finding]:
    rows = accel.rows
    return [
        finding(
            "reference",
            "error",
            "reference_accel",
            f"{rows.log[0].name}: at half of the {len(rows.log)} rests accel differs from reference_accel by "
            f"{accel.given:.2f} of gravity or more, and no exchange of axes explains it: the reference columns do not "
            "belong to these rests.",
            rests=len(rows.log),
            as_given=accel.given,
            misfit=accel.misfit,
        )
    ]


def _single_rests(rows: ReferenceRows, gravity: float, limits: Thresholds) -> list[Finding]:
    """Rests whose reference is another one's, or of the wrong sign."""
    off, size = left(rows, np.eye(3))
    far = size > limits.reference_disagrees * gravity
    if not far.any():
        return []
    swapped = _exchanged_rests(rows, far, gravity, limits)
    places = ", ".join(_place(rows, int(k)) for k in np.flatnonzero(far)[:4])
    if swapped:
        a, b = swapped
        text = (
            f"{rows.log[a].name}: the rests at {_place(rows, a)} and {_place(rows, b)} stand as each other's "
            "reference says: their positions are exchanged."
        )
        return [finding("positions", "error", "reference_accel", text, rests=int(far.sum()))]
    mirrored = [
        axis for axis in range(3)
        if np.all(np.abs(off[far] + 2 * np.eye(3)[axis] * rows.ideal[far])[:, axis] < 0.15 * gravity)
        and np.all(np.abs(np.delete(off[far], axis, axis=1)) < 0.15 * gravity)
    ]  # fmt: skip
    k = int(np.argmax(size))
    sign = f": the sign of reference_accel_{AXES[mirrored[0]]} is wrong" if mirrored else ""
    measured, ideal = (", ".join(f"{v:.2f}" for v in x[k]) for x in (rows.output, rows.ideal))
    return [
        finding(
            "reference",
            "error",
            "reference_accel",
            f"{rows.log[k].name}: accel and reference_accel contradict each other at {int(far.sum())} of {len(far)} "
            f"rests (at {places}), for example ({measured}) and ({ideal}) m/s²{sign}; or the device stood "
            "otherwise there than planned.",
            rests=int(far.sum()),
            of=len(far),
            largest=float(size.max()),
        )
    ]


def _exchanged_rests(
    rows: ReferenceRows, far: Bool[np.ndarray, " row"], gravity: float, limits: Thresholds
) -> tuple[int, int] | None:
    index = np.flatnonzero(far)
    near = limits.reference_agrees * gravity
    for a in index:
        for b in index[index > a]:
            there = np.linalg.norm(rows.output[a] - rows.ideal[b]) < near
            if there and np.linalg.norm(rows.output[b] - rows.ideal[a]) < near:
                return int(a), int(b)
    return None


def _place(rows: ReferenceRows, k: int) -> str:
    recording = rows.log[k].recording
    row = int(rows.start[k])
    position = "" if recording.position is None else f", position {recording.position[row]}"
    several = len({log.name for log in rows.log}) > 1
    name = f"{rows.log[k].name}, " if several else ""
    return f"{name}{rows.log[k].moment(recording.time[row])}{position}"


def _gravity(device: DeviceLogs, rows: ReferenceRows, limits: Thresholds) -> list[Finding]:
    """The reference's norm against [site] gravity, where all rests have one norm."""
    size = np.linalg.norm(rows.ideal, axis=1)
    gravity, usual = device.site.gravity, float(np.median(size))
    off = usual / gravity - 1.0
    if np.ptp(size) > 2e-3 * usual or abs(off) < limits.reference_gravity or abs(off) > 0.05:
        return []
    return [
        finding(
            "gravity",
            "warning",
            "reference_accel",
            f"{rows.log[0].name}: reference_accel has a norm of {usual:.6g} m/s² at rest, but [site] gravity is "
            f"{gravity:.6g} ({1e6 * off:.0f} ppm): one of them is another place's, and scale factors by one "
            "estimator differ by that from the other's.",
            reference=usual,
            site=gravity,
            ppm=1e6 * off,
        )
    ]


def _remounted(rows: ReferenceRows, limits: Thresholds) -> list[Finding]:
    """Runs between which the device turned in its mount: the rotation of each run against the others."""
    runs = [np.flatnonzero(rows.group == g) for g in np.unique(rows.group)]
    runs = [r for r in runs if len(r) >= 4]
    if len(runs) < 2:
        return []
    bias, matrix = _line_fit(rows)
    if matrix is None:
        return []
    turns, errors = [], []
    for r in runs:
        ideal = rows.ideal[r] @ matrix.T
        left = rows.output[r] - bias - ideal
        design = cross_matrix(-ideal).reshape(-1, 3)  # φ × f
        if np.linalg.svd(design, compute_uv=False)[-1] < 0.5 * np.linalg.norm(ideal[0]):
            return []
        turn = np.linalg.lstsq(design, left.ravel(), rcond=None)[0]
        rest = left.ravel() - design @ turn
        turns.append(turn)
        errors.append(float(np.sqrt(np.mean(rest**2)) / np.linalg.norm(ideal[0])))
    turns = np.array(turns)
    apart = np.linalg.norm(turns - np.median(turns, axis=0), axis=1)
    worst = int(np.argmax(apart))
    if apart[worst] < limits.remounted or apart[worst] < 4.0 * max(errors):
        return []
    row = int(runs[worst][0])
    return [
        finding(
            "remounted",
            "warning",
            "accel",
            f"{rows.log[row].name}: in the run that begins at {_place(rows, row)} the device stands turned by "
            f"{np.degrees(apart[worst]):.2f}° against the other runs: it was mounted anew.",
            angle=float(apart[worst]),
            runs=len(runs),
        )
    ]


def _line_fit(
    rows: ReferenceRows,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"] | None]:
    """output = bias + matrix · ideal over all rests."""
    design = np.concatenate([np.ones((len(rows.log), 1)), rows.ideal], axis=1)
    scale = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    if len(design) < 6 or scale[-1] < 0.05 * scale[0]:
        return np.zeros(3), None
    solution = np.linalg.lstsq(design, rows.output, rcond=None)[0]
    return solution[0], solution[1:].T
