"""Compiled programs are let go before a process holds more of them than the system grants, and freed memory with them.

Campaigns differ in their numbers of blocks and channels, so each brings programs of its own, about 240 areas of
memory in all. Linux grants a process 65530 areas; past that, the compiler's next program ends the process with a
segmentation fault; by these numbers after some 270 campaigns.

What a diagnosis frees the C library of Linux keeps, in pieces between others: a process that diagnosed a sweep of an
hour held 0.4 GB more after each, of which 20 MB were in use.
"""

import contextlib
import ctypes
from pathlib import Path

from .._jax import jax


AREAS = Path("/proc/self/maps")
GRANTED = Path("/proc/sys/vm/max_map_count")
FULL = 0.5  # share of the areas that may be in use before a diagnosis


def make_room(areas: Path = AREAS, granted: Path = GRANTED) -> bool:
    """Give freed memory back, and clear JAX's caches where half of the process's areas of memory are in use.

    **Returns** whether they were cleared.

    Programs that are needed again are compiled again, or read from JAX's cache on disk. Nothing is done where the
    system does not say how many areas it grants.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)
    try:
        limit = int(granted.read_text())
        with areas.open("rb") as lines:
            used = sum(1 for _ in lines)
    except (OSError, ValueError):
        return False
    if used <= FULL * limit:
        return False
    jax.clear_caches()
    return True
