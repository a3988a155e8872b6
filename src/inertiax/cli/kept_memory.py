"""The C library's memory for large arrays, kept by the process from one array to the next."""

import os


# Of `mallopt` in glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
_LARGEST = 32 << 20  # bytes of one array: the most that glibc takes from its heap
_UNUSED = 512 << 20  # bytes that the heap may hold for later
_CHOICES = ("MALLOC_", "GLIBC_TUNABLES")  # of the user, who then settles all of it


def keep_freed_memory() -> bool:
    """Have glibc hold what a large array leaves for the next one, in one heap for all threads; whether it does.

    By itself it gives such memory back and asks for it anew, and the system clears each page that it hands out: of ten
    million rows that took a sixth of a calibration (`benchmarks/long_logs.py`). A heap for each thread holds more that
    nobody uses. Other C libraries are left as they are, and so is one that the user has settled by an environment
    variable.
    """
    if any(name.startswith(_CHOICES) for name in os.environ) or not _is_glibc():
        return False
    import ctypes

    mallopt = ctypes.CDLL(None).mallopt
    wanted = {_ARENA_MAX: 1, _MMAP_THRESHOLD: _LARGEST, _TRIM_THRESHOLD: _UNUSED}
    return all(mallopt(option, value) for option, value in wanted.items())


def _is_glibc() -> bool:
    try:
        return bool(os.confstr("CS_GNU_LIBC_VERSION"))
    except (AttributeError, OSError, ValueError):  # no such name, or no such question
        return False
