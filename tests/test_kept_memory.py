"""Memory of large arrays is kept from one to the next, where the C library is glibc and the user has not settled it."""

import os
import platform
import subprocess
import sys


# Page faults of twenty rounds of four arrays of 24 MB, in a thread beside the first: 6144 pages each, had anew.
_SCRIPT = """
import resource, sys, threading
import numpy as np
from inertiax.cli.kept_memory import keep_freed_memory

print(keep_freed_memory() if sys.argv[1] == "kept" else None)

def work():
    four = lambda: [np.ones(3 << 20) for _ in range(4)]
    four()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        four()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)

thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


def _ran(word: str, **environment: str) -> tuple[str, int]:
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MALLOC_", "GLIBC_"))}
    # Pages of 2 MB, which NumPy asks for, would be counted as one.
    given = {**clean, "NUMPY_MADVISE_HUGEPAGE": "0", **environment}
    command = [sys.executable, "-c", _SCRIPT, word]
    made = subprocess.run(command, env=given, capture_output=True, text=True, check=True)
    told, faults = made.stdout.split()
    return told, int(faults)


def test_large_arrays_do_not_ask_the_system_for_pages_again():
    told, kept = _ran("kept")
    glibc = platform.libc_ver()[0] == "glibc"
    assert told == str(glibc)  # another C library is left as it is
    if glibc:
        _, given_back = _ran("as it is")
        assert given_back > 100_000  # of 491 520: what glibc keeps by itself is its own choice
        assert kept < 0.01 * given_back  # the first four arrays are had before counting


def test_what_the_user_has_settled_stays():
    assert _ran("kept", MALLOC_ARENA_MAX="4")[0] == "False"
