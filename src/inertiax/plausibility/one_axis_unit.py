"""One accelerometer axis in another unit than the other two, by what 1 g reads on each axis."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import ACCEL_UNITS
from . import remedies
from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


_UNKNOWNS = 6  # a centre and a semi-axis for each channel
_LEAST_SINGULAR = (
    0.02  # of the largest singular value: below, the directions do not tell all three semi-axes
)
_ROUND = 0.05  # rms of |a|/g − 1 that an ellipsoid may leave: misalignments and raw scales of working sensors
_SPREAD = (
    0.2  # of an axis' range, relative to its largest: below, a reference does not tell the slope
)
# Of an axis' variance over the rests that goes with its reference: all of it in any unit, but for rests that stand
# otherwise than the reference says. Exchanged axes have none where the attitudes are spread.
_FOLLOWS = 0.5


def check_one_axis(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """What 1 g reads on each axis over what it reads on the other two, where one differs by more than an error's limit.

    By the slope over the reference, or by the ellipsoid along the axes on which the means at rest lie,
    $\\sum_k ((m_k - c_k) / r_k)^2 = 1$.
    """
    means = [m for log in device.logs if (m := log.over_rests("accel")) is not None]
    if not means:
        return []
    output = np.concatenate([m.mean for m in means])
    ideal = [log.over_rests("reference_accel") for log in device.logs]
    reads = None
    if all(r is not None for r in ideal):
        reads = _by_reference(output, np.concatenate([r.mean for r in ideal if r is not None]))
    reads = _by_ellipsoid(output, device.site.gravity) if reads is None else reads
    if reads is None:
        return []
    ratios = np.array([reads[k] / np.median(np.delete(reads, k)) for k in range(3)])
    alike = [
        max(a / b, b / a) < limits.accel_ratio_warning
        for a, b in (np.delete(reads, k) for k in range(3))
    ]
    odd = [
        k
        for k in range(3)
        if alike[k] and max(ratios[k], 1.0 / ratios[k]) > limits.accel_ratio_error
    ]
    if len(odd) != 1:
        return []
    axis, ratio = odd[0], float(ratios[odd[0]])
    name, others = "xyz"[axis], " and ".join(np.delete(list("xyz"), axis))
    unit = _unit(device, ratio)
    likely = "look at its unit and scale" if unit is None else f'likely in "{unit}"'
    return [
        finding(
            "accel_unit",
            "error",
            "accel",
            f"{device.logs[0].name}: accel_{name} reads {ratio:.3g} times what {others} read of the same gravity: that "
            f"axis is in another unit; {likely}.",
            remedy=remedies.axes_rescaled(
                "accel", device.columns, (axis,), _factor(device, unit, ratio)
            ),
            ratio=ratio,
            rests=len(output),
        )
    ]


def _unit(device: DeviceLogs, ratio: float) -> str | None:
    """The unit in which the other axes' reading would be `ratio` times as large."""
    said = device.columns.accel
    now = ACCEL_UNITS.get((said.unit if said is not None else None) or "m/s^2")
    return None if now is None else remedies.known_unit("accel", now / ratio)


def _factor(device: DeviceLogs, unit: str | None, ratio: float) -> float:
    """By which the axis' values have to be multiplied: the unit's, or the measured one."""
    said = device.columns.accel
    now = ACCEL_UNITS.get((said.unit if said is not None else None) or "m/s^2")
    return 1.0 / ratio if unit is None or now is None else ACCEL_UNITS[unit] / now


def _by_reference(
    output: Float[np.ndarray, "rest 3"], ideal: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "3"] | None:
    """Slope of each axis over its reference, without units; `None` where a reference hardly changes, or an axis does
    not follow its own, as where axes are exchanged."""
    told = np.any(ideal, axis=1)
    output, ideal = output[told], ideal[told]
    size = np.abs(ideal).max(initial=0.0)
    if len(output) < 3 or not size > 0.0 or np.any(np.ptp(ideal, axis=0) < _SPREAD * size):
        return None
    away = ideal - ideal.mean(axis=0)
    slope = np.sum(away * output, axis=0) / np.sum(away**2, axis=0)
    whole = np.sum((output - output.mean(axis=0)) ** 2, axis=0)
    follows = slope**2 * np.sum(away**2, axis=0) > _FOLLOWS * whole
    return np.abs(slope) if follows.all() else None


def _by_ellipsoid(
    output: Float[np.ndarray, "rest 3"], gravity: float
) -> Float[np.ndarray, "3"] | None:
    """Semi-axes over gravity of the ellipsoid through the means; `None` where they lie on none, or do not tell it."""
    if len(output) <= _UNKNOWNS:
        return None
    size = np.abs(output).max(axis=0)
    if not np.all(size > 0.0):
        return None
    m = output / size
    # One unit explains all, as where gravity was hardly ever along one axis.
    if _on_gravitys_sphere(output, gravity):
        return None
    design = np.column_stack([m**2, m])  # Σ p m² + q m = 1
    found, _, _, singular = np.linalg.lstsq(design, np.ones(len(m)), rcond=None)
    p, q = found[:3], found[3:]
    if singular[-1] < _LEAST_SINGULAR * singular[0] or np.any(p <= 0.0):
        return None
    centre = -0.5 * q / p
    radius = np.sqrt((1.0 + np.sum(p * centre**2)) / p)
    left = np.linalg.norm((m - centre) / radius, axis=1) - 1.0
    if np.sqrt(np.mean(left**2)) > _ROUND:
        return None
    return size * radius / gravity


def _on_gravitys_sphere(output: Float[np.ndarray, "rest 3"], gravity: float) -> bool:
    """Whether gravity and one small offset leave no more than working sensors do: |m| = g + c·m/|m|."""
    size = np.linalg.norm(output, axis=1)
    if not np.all(size > 0.0):
        return False
    up, over = output / size[:, None], size / gravity - 1.0
    left = over - up @ np.linalg.lstsq(up, over, rcond=None)[0]
    return bool(np.sqrt(np.mean(left**2)) <= _ROUND)
