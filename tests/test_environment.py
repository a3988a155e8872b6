"""What the command line sets up before JAX starts."""

import os
import subprocess
import sys

import pytest

from bad_inputs_cases import good_calibration
from inertiax.cli import environment


FLAG = "--xla_cpu_use_fusion_emitters=false"


@pytest.fixture
def jaxlib(monkeypatch):
    """Have `prepare` see a version of jaxlib, and no flags of the user's."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")  # leaves the tests' own cache as it is
    monkeypatch.setenv("XLA_FLAGS", "")  # so that what was there, or nothing, comes back
    monkeypatch.delenv("XLA_FLAGS")
    return lambda text: monkeypatch.setattr(environment, "version", lambda name: text)


def test_one_device_is_compiled_for_by_the_quicker_generator(jaxlib):
    jaxlib("0.10.2")
    environment.prepare()
    assert os.environ["XLA_FLAGS"] == FLAG


@pytest.mark.parametrize("text", ["0.9.2", "0.11.0", "1.0.0", "0.100.0"])
def test_a_jaxlib_that_may_not_know_the_flag_gets_none(jaxlib, text):
    jaxlib(text)
    environment.prepare()
    assert "XLA_FLAGS" not in os.environ


def test_a_fleet_keeps_the_generator_of_the_faster_programs(jaxlib):
    jaxlib("0.10.2")
    environment.prepare(accelerator=True)
    assert "XLA_FLAGS" not in os.environ


def test_the_users_own_flags_stand(jaxlib, monkeypatch):
    jaxlib("0.10.2")
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    environment.prepare()
    assert os.environ["XLA_FLAGS"] == "--xla_cpu_multi_thread_eigen=false"


@pytest.mark.parametrize(("chosen", "kept"), [(None, "1"), ("4", "4")])
def test_narrow_matrices_get_one_thread_unless_the_user_chose(jaxlib, monkeypatch, chosen, kept):
    jaxlib("0.10.2")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", chosen or "")
    if chosen is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    environment.prepare()
    assert os.environ["OPENBLAS_NUM_THREADS"] == kept


CACHED = """
import sys
from inertiax.cli.environment import prepare
prepare()
import jax, jax.numpy as jnp
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
def doubled(x):
    return jnp.sin(2.0 * x)
print(float(jax.jit(doubled)(0.0)))
"""


@pytest.mark.slow
def test_a_damaged_entry_of_the_cache_is_written_anew_without_a_word(tmp_path):
    cache = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    run = lambda: subprocess.run(
        [sys.executable, "-c", CACHED], capture_output=True, text=True, env=cache
    )
    assert run().stdout == "0.0\n"
    (entry,) = tmp_path.glob("jit_doubled-*-cache")
    whole = entry.read_bytes()
    entry.write_bytes(whole[: len(whole) // 2])  # of a run that was killed while it wrote
    done = run()
    assert (done.stdout, done.stderr) == ("0.0\n", "")
    assert len(entry.read_bytes()) > len(whole) // 2
    entry.write_bytes(whole[: len(whole) // 2])
    code = CACHED.replace(
        "prepare()\n", "prepare()\nimport warnings; warnings.warn('other', stacklevel=1)\n", 1
    )
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", code], capture_output=True, text=True, env=cache
    )
    assert "other" in done.stderr and "Error reading" not in done.stderr


LATER = """
import sys
from pathlib import Path
from inertiax.cli.environment import prepare_without_jax
prepare_without_jax()
import numpy as np
from inertiax.calibration.calibration import read_calibration
from inertiax.calibration.over_rows import compensated_rows
from inertiax.reduction.dwells import Dwells
calibration = read_calibration(Path(sys.argv[1]))
rng = np.random.default_rng(0)
samples = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), np.linspace(15.0, 25.0, 5)
host = compensated_rows(calibration, *samples)
assert "jax" not in sys.modules
import jax
device = jax.jit(jax.vmap(calibration))(*samples)
print(max(float(abs(a - b).max()) for a, b in zip(host, device)))
print(jax.tree.leaves(calibration.accel)[0].shape, jax.config.jax_enable_x64)
"""


@pytest.mark.slow
def test_records_that_were_made_without_jax_are_pytrees_once_it_is_loaded(tmp_path):
    path = tmp_path / "calibration.json"
    path.write_bytes(good_calibration(thermal=True))
    done = subprocess.run(
        [sys.executable, "-c", LATER, str(path)], capture_output=True, text=True, check=True
    )
    difference, told = done.stdout.splitlines()
    assert float(difference) < 1e-14  # inputs of order 1
    assert told.endswith(") True") and told.startswith("(")
