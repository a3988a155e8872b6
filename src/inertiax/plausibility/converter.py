"""A bit of a converter that never changes: codes come in blocks with as wide gaps between them."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import AXES
from ..reduction.mean_noise import converter_steps
from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .samples import UNITS
from .thresholds import Thresholds


_BITS = range(1, 12)
_FEWEST_BLOCKS = (
    8  # occupied blocks and gaps between them: by luck 2⁻⁸ at the most, less with their length
)
_FEWEST_CODES = 60


def check_converter(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Every channel with a recognisable converter step."""
    del limits
    return [
        found
        for log in device.logs
        for name, values in triads(log)
        for axis, step in enumerate(converter_steps(values))
        for found in _one(log, name, axis, values[:, axis], float(step))
    ]


def _one(
    log: Log, name: str, axis: int, x: Float[np.ndarray, " time"], step: float
) -> list[Finding]:
    if step <= 0:
        return []
    codes = np.unique(_codes(x, step))
    if len(codes) < _FEWEST_CODES:
        return []
    for bit in _BITS:
        if _never_set(codes, 2**bit):
            size = step * 2**bit
            return [
                finding(
                    "stuck_bit",
                    "warning",
                    f"{name}_{AXES[axis]}",
                    f"{log.name}: the converter of {name}_{AXES[axis]} never changes one bit, worth {size:.3g} "
                    f"{UNITS[name]}: half of all codes do not occur.",
                    step=step,
                    bit=bit,
                    size=size,
                )
            ]
    return []


def _codes(x: Float[np.ndarray, " time"], step: float) -> np.ndarray:
    """Whole steps above the least value, the step refined from small multiples to large ones (text is rounded)."""
    above = np.unique(x) - x.min()
    for most in (30.0, 1000.0, 1e9):
        near = above[above < most * step]
        whole = np.round(near / step)
        if np.any(whole > 0):
            step = float(near @ whole / (whole @ whole))
    return np.round((x - x.min()) / step).astype(np.int64)


def _never_set(codes: np.ndarray, block: int) -> bool:
    """Whether codes, modulo two blocks, fill one block and leave the other empty, over many blocks."""
    rest = np.bincount(codes % (2 * block), minlength=2 * block) > 0
    if rest.sum() > block or rest.sum() < 0.6 * block:
        return False
    # The occupied residues have to lie within one block, cyclically.
    doubled = np.concatenate([rest, rest])
    filled = np.cumsum(np.append(0, doubled))
    start = int(np.argmax(filled[block : block + 2 * block] - filled[: 2 * block]))
    if filled[start + block] - filled[start] != rest.sum():
        return False
    numbers = np.unique((codes - start) // (2 * block))
    neighbours = int(np.sum(np.diff(numbers) == 1))
    return len(numbers) >= _FEWEST_BLOCKS and neighbours >= _FEWEST_BLOCKS // 2
