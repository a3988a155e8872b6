r"""A device that turned in its mount: from one moment on its outputs stand turned against all references.

With bias b, matrix M ≈ E and the reference force $f_j$ of rest j, a small rotation $\varphi$ of the case from a moment
$t_0$ on makes the accelerometers read, to first order,

$$a_j = b + M f_j + H(t_j - t_0) \, \varphi \times f_j.$$

A constant $\varphi$ is a misalignment, which the calibration fits. The turn is taken at the best moment, by an F test
times the number of moments (Bonferroni), beside b and M that follow the temperature where that moves. It has to explain
most of what the references leave: an effect of the sensor that is merely the larger in one half does not. Gyros on the
table's rates have the same equation; where they have plateaus on both sides they tell whether they turned, too.
"""

import dataclasses
import math

import numpy as np
import scipy.special
from jaxtyping import Bool, Float

from ..data.formats.columns import AXES
from ..physics.vectors import cross_matrix
from .exchanged_axes import ReferenceRows
from .finding import Finding, finding
from .thresholds import Thresholds


_SIDE = 4  # rests on either side: 12 rows for 3 unknowns (convention)
_SPARE = 6  # equations beyond all unknowns, fewer of which tell no misfit (convention)
_DEGREES = 3  # of the course of b and M over temperature, as the calibration's
# Of the squares that the references leave, what the turn may leave of them: a tenth, so that it is most of the misfit.
_LEAVES = 0.1
_ALIKE = 0.5  # of the accelerometers' turn, up to which the gyros' is the same, or none


@dataclasses.dataclass(frozen=True, eq=False)
class Turn:
    """One rotation of the outputs against their references, from one row on."""

    at: int  # the first row that is turned
    angle: Float[np.ndarray, "3"]  # rad
    chance: float  # of its F test, over all moments
    leaves: float  # of the squares that the references leave


def turned_mount(
    accel: ReferenceRows, gyro: ReferenceRows | None, limits: Thresholds
) -> list[Finding]:
    """A warning where all rests from one on stand turned alike against their references."""
    turn = _turn(accel, limits)
    if turn is None or turn.chance > limits.turned_by_chance or turn.leaves > _LEAVES:
        return []
    size = float(np.linalg.norm(turn.angle))
    if size < limits.turned_mount:
        return []
    log, row = accel.log[turn.at], int(accel.start[turn.at])
    recording = log.recording
    label = "" if recording.position is None else f" (position {recording.position[row]})"
    about = AXES[int(np.argmax(np.abs(turn.angle)))]
    gyros = _gyros(accel, gyro, turn)
    what = "device stands" if gyros is not False else "accelerometers stand"
    cause = {
        None: "it moved in its mount, or the references are another mounting's",
        True: "so do the gyros, by the rates: it moved in its mount, or the references are another mounting's",
        False: "but the gyros do not, by the rates: one triad was mounted anew",
    }[gyros]
    return [
        finding(
            "remounted",
            "warning",
            "accel",
            f"{log.name}: from {log.moment(recording.time[row])} on{label} the {what} turned by "
            f"{math.degrees(size):.2g}° against the references, mostly about {about}, "
            f"by {turn.at} rests before and {len(accel.log) - turn.at} after: {cause}. Calibrate both parts for "
            "themselves.",
            angle=size,
            rotation=tuple(float(v) for v in turn.angle),
            began=float(recording.time[row]),
            rests_before=turn.at,
            rests_after=len(accel.log) - turn.at,
            gyros_too=gyros is True,
            chance=turn.chance,
        )
    ]


def _turn(rows: ReferenceRows, limits: Thresholds) -> Turn | None:
    """The turn at the best moment; `None` where rows are too few or tell none."""
    count = len(rows.log)
    base = _base(rows, limits)
    freedom = 3 * (count - base.shape[1]) - 3
    if count < 2 * _SIDE or freedom < _SPARE:
        return None
    frame = np.linalg.qr(base)[0]
    left = rows.output - frame @ (frame.T @ rows.output)
    turned = cross_matrix(-rows.ideal)  # φ × f = [−f]× φ
    later = lambda x: np.cumsum(x[::-1], axis=0)[::-1]  # sums from each row on
    slope = later(np.einsum("jai,ja->ji", turned, left))
    taken = later(np.einsum("jp,jai->jpai", frame, turned))
    normal = later(np.einsum("jai,jak->jik", turned, turned))
    own = np.trace(normal, axis1=1, axis2=2)
    normal = normal - np.einsum("spai,spak->sik", taken, taken)
    kept = float(np.sum(np.square(left)))
    best: tuple[float, int, np.ndarray] | None = None
    for at in range(_SIDE, count - _SIDE + 1):
        # Beside b and M nothing tells a turn that they stand in for.
        if np.linalg.eigvalsh(normal[at])[0] < 1e-3 * own[at]:
            continue
        angle = np.linalg.solve(normal[at], slope[at])
        gain = float(slope[at] @ angle)
        if best is None or gain > best[0]:
            best = gain, at, angle
    if best is None or kept <= 0.0:
        return None
    gain, at, angle = best
    rest = max(kept - gain, 1e-12 * kept)
    ratio = gain / 3.0 / (rest / freedom)
    chance = (count - 2 * _SIDE + 1) * float(scipy.special.fdtrc(3, freedom, ratio))
    return Turn(at, angle, chance, rest / kept)


def _base(rows: ReferenceRows, limits: Thresholds) -> Float[np.ndarray, "row unknown"]:
    """Columns of b and M, by powers of the temperature where it moves: up to `_DEGREES`, and as the rows allow."""
    plain = np.concatenate([np.ones((len(rows.log), 1)), rows.ideal], axis=1)
    warm = _temperature(rows)
    if warm is None or np.ptp(warm) < limits.one_temperature:
        return plain
    x = 2.0 * (warm - warm.min()) / np.ptp(warm) - 1.0
    levels = 1 + int(np.count_nonzero(np.diff(np.sort(warm)) > limits.one_temperature))
    degree = min(_DEGREES, max(levels - 1, 1))
    return np.concatenate([plain * x[:, None] ** k for k in range(degree + 1)], axis=1)


def _temperature(rows: ReferenceRows) -> Float[np.ndarray, " row"] | None:
    """The probe at the beginning of each row's rest; `None` where some recording has none."""
    told = [log.recording.temperature for log in rows.log]
    if any(t is None for t in told):
        return None
    return np.array([t[k, 0] for t, k in zip(told, rows.start, strict=True) if t is not None])


def _gyros(accel: ReferenceRows, gyro: ReferenceRows | None, turn: Turn) -> bool | None:
    """Whether the gyros turned with the accelerometers, by rates before and after; `None` where these do not tell."""
    if gyro is None:
        return None
    order = {id(log): k for k, log in enumerate(dict.fromkeys(accel.log))}
    moment = order[id(accel.log[turn.at])], int(accel.start[turn.at])
    after = np.array(
        [(order.get(id(log), -1), int(k)) >= moment for log, k in zip(gyro.log, gyro.start)]
    )
    found = _turn_of_gyros(gyro, after)
    if found is None:
        return None
    size = float(np.linalg.norm(turn.angle))
    if np.linalg.norm(found - turn.angle) < _ALIKE * size:
        return True
    return False if np.linalg.norm(found) < _ALIKE * size else None


def _turn_of_gyros(
    rows: ReferenceRows, after: Bool[np.ndarray, " row"]
) -> Float[np.ndarray, "3"] | None:
    """φ of the gyros at a moment that is known; `None` where their rates do not determine it."""
    plain = np.concatenate([np.ones((len(rows.log), 1)), rows.ideal], axis=1)
    turned = cross_matrix(-rows.ideal) * after[:, None, None]
    design = np.concatenate([np.kron(plain, np.eye(3)), turned.reshape(-1, 3)], axis=1)
    size = np.linalg.norm(design, axis=0)
    if np.any(size == 0.0):
        return None
    scale = np.linalg.svd(design / size, compute_uv=False)
    if len(design) < design.shape[1] + _SPARE or scale[-1] < 1e-3 * scale[0]:
        return None
    return np.linalg.lstsq(design, rows.output.reshape(-1), rcond=None)[0][-3:]
