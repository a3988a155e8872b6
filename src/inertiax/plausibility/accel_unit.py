"""The accelerometers' unit: at rest they read gravity, or what the reference says."""

import numpy as np
from jaxtyping import Float

from ..physics.directions import num_directions
from . import remedies
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .one_axis_unit import check_one_axis
from .thresholds import Thresholds


def check_accel_unit(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """|a| at rest over what it should be, each recording's median; first, each axis over the others."""
    found = check_one_axis(device, limits)
    if found:
        return found  # the norm says no more
    alone = _one_pose(device)
    for log in device.logs:
        accel = log.recording.accel
        if accel is None or np.any(np.ptp(accel, axis=0) == 0) and len(accel) >= 100:
            continue  # a dead channel is told of elsewhere
        norm, ratio = _ratio(log, device.site.gravity)
        off = max(ratio, 1.0 / max(ratio, 1e-300))
        if off < (limits.accel_one_pose_warning if alone else limits.accel_ratio_warning):
            continue
        remedy, unit = remedies.rescaled("accel", device.columns, 1.0 / max(ratio, 1e-300))
        certain = off > limits.accel_ratio_error
        likely = "check unit, scale and offset" if unit is None else f"likely {unit}"
        if unit is None and ratio > 10:
            likely = "likely raw counts, which need scale and offset of the data sheet"
        if off < limits.accel_ratio_warning:
            likely = (
                "a bias, a scale factor or the unit is off: one pose cannot tell which; add others"
            )
        found.append(
            finding(
                "accel_unit",
                "error" if certain else "warning",
                "accel",
                f"{log.name}: accel has a median norm of {norm:.4g} m/s² at rest, {ratio:.3g} times what it "
                f"should be ({norm / max(ratio, 1e-300):.4g}); {likely}.",
                remedy=remedy if certain else None,
                ratio=ratio,
                norm=norm,
                rests=log.num_rests,
            )
        )
    return found


def _one_pose(device: DeviceLogs) -> bool:
    """Whether accelerometers without a reference rest in a single direction, so that no fit tells bias from scale."""
    if any(r.reference_accel is not None for r in device.recordings):
        return False
    means = [m.mean for log in device.logs if (m := log.over_rests("accel")) is not None]
    return bool(sum(map(len, means))) and num_directions(np.concatenate(means), most=2) == 1


def _ratio(log: Log, gravity: float) -> tuple[float, float]:
    """Median norm of the samples at rest, m/s², and its ratio to gravity or the reference's norm.

    Of samples, not of means: where no rest is known, all rows count, and they may turn.
    """
    assert log.recording.accel is not None
    rows = log.at_rest if log.num_rests else np.ones(log.recording.num_samples, bool)
    norms = _norm(log.recording.accel[rows])
    if log.recording.reference_accel is not None:
        ideal = _norm(log.recording.reference_accel[rows])
        if np.all(ideal > 0.1 * gravity):
            return float(np.median(norms)), float(np.median(norms / ideal))
    return float(np.median(norms)), float(np.median(norms)) / gravity


def _norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.linalg.norm(vectors, axis=1)
