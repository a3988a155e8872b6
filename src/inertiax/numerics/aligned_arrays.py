"""Arrays of the host that XLA reads where they lie: of others a compiled program on processors takes a copy first."""

import numpy as np
from numpy.typing import DTypeLike


ALIGNMENT = 64  # bytes: a vector of 512 bits, and what XLA asks of its buffers


def empty_aligned(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """An array without content whose first element lies at a multiple of `ALIGNMENT`.

    A compiled program may still read it after its call returned: write to it again only when the results are there.

    ```python
    x = empty_aligned((3, 18, 64), np.float64)
    ```
    """
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    room = np.empty(size + ALIGNMENT, np.uint8)
    first = -room.ctypes.data % ALIGNMENT
    return room[first : first + size].view(kind).reshape(shape)
