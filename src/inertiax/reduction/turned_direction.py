"""How far a direction fixed in the room turns in the case, by rates step by step. NumPy, many motions at once."""

import numpy as np
from jaxtyping import Float


def turned(angle: Float[np.ndarray, "motion step 3"]) -> Float[np.ndarray, "motion 3 3"]:
    """Product of the steps' rotations exp(−[φ]×), the last leftmost, by halving the number of factors.

    **Arguments:** `angle` is φ = ω Δt of every step, rad. **Returns** U with u(end) = U u(start).
    """
    q = _quaternion(-angle)
    while q.shape[1] > 1:
        if q.shape[1] % 2:
            q = np.concatenate([q, np.broadcast_to([1.0, 0, 0, 0], (len(q), 1, 4))], axis=1)
        q = _product(q[:, 1::2], q[:, ::2])
    return _matrix(q[:, 0])


def _quaternion(angle: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 4"]:
    size = np.linalg.norm(angle, axis=-1, keepdims=True)
    return np.concatenate([np.cos(0.5 * size), 0.5 * np.sinc(size / (2 * np.pi)) * angle], axis=-1)


def _product(a: Float[np.ndarray, "*n 4"], b: Float[np.ndarray, "*n 4"]) -> np.ndarray:
    """Hamilton's product: the turn b, then the turn a."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    parts = [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + bw * ax + ay * bz - az * by,
        aw * by + bw * ay + az * bx - ax * bz,
        aw * bz + bw * az + ax * by - ay * bx,
    ]
    return np.stack(parts, axis=-1)


def _matrix(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
