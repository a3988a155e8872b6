"""What the command line sets up before JAX is used: 64-bit numbers and a cache of compiled code."""

import gc
import glob
import hashlib
import os
import platform
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

from .kept_memory import keep_freed_memory


KNOWING = ("0.10.",)  # versions of jaxlib


def prepare(*, accelerator: bool = False) -> None:
    """Set 64-bit arithmetic, and keep compiled programs in the user's cache folder.

    A cache that cannot be used is left out: it saves seconds and may never fail a run. One device's
    calibration is too small for a GPU to be quicker, so only a command that asks for an
    `accelerator` uses one (or a user who sets `JAX_PLATFORMS`).
    """
    if not accelerator:
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
        _compile_sooner()
    _settle_process()
    import jax

    jax.config.update("jax_enable_x64", True)
    _keep_programs()


def _keep_programs() -> None:
    """Have JAX keep what it compiles."""
    import jax

    own = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if own is not None:  # the user's own choice, which JAX reads itself
        _renew_damaged(Path(own))
        return
    folder = _usable_folder()
    if folder is not None:
        _renew_damaged(folder)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        # A run compiles a hundred small programs; together they take longer than the large ones.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def prepare_without_jax() -> None:
    """As `prepare`, for a command whose work is done by NumPy: it starts in half the time.

    Data that need JAX all the same load it, as `prepare` would have.
    """
    if "jax" in sys.modules:
        prepare()
        return
    keep_freed_memory()
    _settle_process()
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    _compile_sooner()
    from .. import _without_jax as _without_jax
    from .._records import when_loaded

    when_loaded(_keep_programs)


@contextmanager
def prepared_to_draw(module: str, *, several: bool = False) -> Iterator[None]:
    """As `prepare_without_jax`, and what a `module` draws is drawn by other processes while the block lasts."""
    prepare_without_jax()
    from ..plots.figure_workers import drawn_aside

    with drawn_aside(module, several=several):
        yield


def _settle_process() -> None:
    """What JAX, NumPy and Python are to do otherwise than by themselves."""
    # Matrices of a diagnosis are long and narrow: a second thread of OpenBLAS waits more than it works.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Remarks of XLA's C++ side about cached code would mix with the command's own lines.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    # A linear solve that fails inside a derivative gives NaN, which is judged as every outcome is.
    # Raising needs a callback into Python, and code with callbacks is never cached.
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    # Warnings are for developers, who ask for them with -W or PYTHONWARNINGS; what a user should know
    # is in the result.
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    # Imports make half a million objects and no rubbish: looking for it seven hundred at a time took 0.3 s of 1.8.
    gc.set_threshold(50_000, 20, 50)


_DAMAGED = re.compile(r"Error reading persistent compilation cache entry for '([^']+)'")


def _renew_damaged(folder: Path) -> None:
    """Have JAX write entries of its cache anew that it could not read, such as those of a run that was killed.

    JAX compiles the program then and warns, but leaves a file that is there as it is, so every further run would
    compile it, too. The warning names the program and comes before the new entry is written.
    """
    shown = warnings.showwarning

    def show(message, category, filename, lineno, file=None, line=None):
        found = _DAMAGED.match(str(message))
        if found is None:
            shown(message, category, filename, lineno, file, line)
            return
        for entry in folder.glob(f"{glob.escape(found[1])}-*-cache"):
            with suppress(OSError):
                entry.unlink()

    warnings.showwarning = show
    warnings.filterwarnings("always", _DAMAGED.pattern)


def _compile_sooner() -> None:
    """Have XLA's older code generator for the processor, unless the user has chosen flags.

    The newer one takes nearly twice as long to compile the same programs, which saves one device's run less than a
    tenth (`benchmarks/diagnose_rows.py`: compilation 11.5 and 6.8 s, run 11.0 and 11.9 s). A flag
    that XLA does not know ends the process, so it is set for the versions that it was tried with.
    """
    if version("jaxlib").startswith(KNOWING):
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")


def _usable_folder() -> Path | None:
    try:
        folder = cache_folder() / f"jax-{_machine()}"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: a user without a home folder
        return None
    return folder if os.access(folder, os.R_OK | os.W_OK | os.X_OK) else None


def cache_folder() -> Path:
    """The user's cache folder for inertiax, by the platform's rules."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        # The XDG specification: a relative path is invalid and to be ignored.
        base = base if os.path.isabs(base) else str(Path.home() / ".cache")
    return Path(base) / "inertiax"


def _machine() -> str:
    """Names the processor and compiler, since code for one may be illegal on another.

    Home folders are shared between the machines of a cluster.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        features = platform.processor()
    text = f"{platform.machine()} {features} {version('jaxlib')}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]
