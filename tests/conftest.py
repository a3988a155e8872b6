"""64-bit arithmetic, strict promotion, and seeded randomness for every test."""

import contextlib
import gc
import os
from importlib.metadata import version
from pathlib import Path

import compiled_programs


# Before JAX starts: one device, no accelerator probing.
os.environ.setdefault("JAX_PLATFORMS", "cpu")

# Tests and the processes that they start run most programs for milliseconds, so compiling is what they cost. LLVM's
# optimiser, which is left out, changes the speed of the same formulas and nothing else.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")

# Before NumPy starts, as in `cli/environment.py`; the workers keep all cores busy as it is.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Most of the time goes into compiling, small operations too: each program is compiled once for all workers and the
# processes that tests start, which inherit this environment, and for the runs of the next weeks.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(compiled_programs.folder())
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

# Where Python may not write compiled modules beside their sources, each of some hundred processes that tests start
# would compile a thousand anew, for 2 s: they are kept with the programs.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    modules = Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "modules"
    os.environ.setdefault("PYTHONPYCACHEPREFIX", str(modules))

# The code generator that this flag turns off takes nearly twice as long to compile, as in `cli/environment.py`, whose
# choice this is. A jaxlib that does not know the flag would not start, so it is for those it was tried with.
if version("jaxlib").startswith("0.10."):
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")

import jax
import pytest

import long_programs
import typed_calls


# Before the package is imported.
typed_calls.install()
long_programs.install()

# What is imported for all tests stays: going through it again and again is a quarter of collecting them.
gc.disable()


def pytest_collection_finish() -> None:
    """From here on garbage is collected, but for what is there already."""
    gc.freeze()
    # As in `cli/environment.py`: tracing makes objects by the hundred thousand and little rubbish, and looking for it
    # seven hundred at a time takes a twentieth of the time.
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


# Files of the slow tier that take ten seconds or more, the longest first: what is begun last keeps one worker alone.
LONG = """
    tutorials procedure first_layer_precision real_recordings one_model fleet diagnose sensitivity bilinear
    degree_beside live_recordings live_command practice_campaigns estimators no_open_port hostile_files calibration
    delays library_page navigation_filter gravity_rotation earth_at_rest joint_imu fleet_population covariance
    library_pytree add_an_effect type_noise separate simulate package_lag allan alike fleet_sharding fit_arrays design
    fleet_report blind_generator solve filter_segment fleet_mismatch command_line any_output adapters library_checks
    navigation bad_commands cli approaches
""".split()
RANK = {f"test_{name}.py": place for place, name in enumerate(LONG)}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; each file stays together."""
    items.sort(key=lambda item: RANK.get(item.path.name, len(RANK)))


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Types are checked at the first calls in making what tests share."""
    typed_calls.begin_anew()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call() -> None:
    """And again at the first calls of each test."""
    typed_calls.begin_anew()


def make_room() -> None:
    """As a diagnosis does; the package is imported where a test first needs it."""
    from inertiax.numerics import compilation_cache

    compilation_cache.make_room()


def _let_go_beyond(most: float) -> None:
    """Forget compiled programs where the process holds more than `most` bytes; JAX's cache on disk has them."""
    with contextlib.suppress(OSError):  # not Linux
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        if pages * os.sysconf("SC_PAGE_SIZE") > most:
            jax.clear_caches()
            gc.collect()
            make_room()


# A process of tests holds at most 2 GB: the programs of one test take up to 0.6, those of one file up to 0.9. Late in a
# run a process without any holds 0.95, so that a bound near it would let them go for every file.
@pytest.fixture(autouse=True, scope="module")
def _room_for_programs():
    """Two thousand tests in one process compile more programs than a process may hold."""
    _let_go_beyond(1.3e9)
    make_room()


@pytest.fixture(autouse=True)
def _room_in_a_file():
    """Some files' tests have large programs each."""
    _let_go_beyond(1.4e9)


@pytest.fixture
def getkey(request):
    """Fresh JAX random keys from a seed fixed by the test's name, so that a failure repeats."""
    state = [jax.random.PRNGKey(sum(request.node.name.encode()))]

    def _getkey():
        state[0], key = jax.random.split(state[0])
        return key

    return _getkey
