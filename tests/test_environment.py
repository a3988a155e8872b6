"""What the command line sets up before JAX starts."""

import os

import pytest

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
