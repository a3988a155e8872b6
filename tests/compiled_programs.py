"""Where the tests' compiled programs are kept from one run to the next: a second run takes a quarter less time."""

import atexit
import contextlib
import hashlib
import os
import platform
import shutil
import tempfile
import time
from importlib.metadata import version
from pathlib import Path


DAYS = 14  # after which a program is compiled anew, so that those of old code go


def folder() -> Path:
    """In the user's cache (`XDG_CACHE_HOME`), one for each jaxlib and processor; where it cannot be used, one that goes
    with this run."""
    cpu = Path("/proc/cpuinfo")
    flags = (
        sorted({x for x in cpu.read_text().splitlines() if x.startswith(("flags", "Features"))})
        if cpu.exists()
        else []
    )
    machine = [version("jax"), version("jaxlib"), platform.machine(), platform.processor(), *flags]
    name = hashlib.sha256("\n".join(machine).encode()).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    kept = Path(home) / "inertiax-tests" / name
    try:
        kept.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=kept):
            pass
    except OSError:
        made = tempfile.mkdtemp(prefix="inertiax-tests-")
        atexit.register(shutil.rmtree, made, ignore_errors=True)
        return Path(made)
    oldest = time.time() - DAYS * 86400.0
    for program in kept.iterdir():
        with contextlib.suppress(OSError):  # another run may be taking it away
            if program.stat().st_mtime < oldest:
                program.unlink()
    return kept
