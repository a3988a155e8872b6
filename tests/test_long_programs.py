"""The programs that tests have optimised are there, and the others are compiled as before."""

import importlib

import jax
import pytest

import long_programs


@pytest.mark.parametrize("name", long_programs.NAMES)
def test_each_is_a_program_of_the_package(name):
    module, _, function = name.rpartition(".")
    assert hasattr(getattr(importlib.import_module(module), function), "lower")


def test_only_those_that_are_named_have_the_option(monkeypatch):
    asked = []
    monkeypatch.setattr(jax, "jit", lambda function, **options: asked.append(options))
    long_programs.install()

    def short(x):
        return x

    def long(x):
        return x

    monkeypatch.setattr(long_programs, "NAMES", (f"{__name__}.{long.__qualname__}",))
    jax.jit(short)
    jax.jit(long)
    jax.jit(static_argnums=0)(short)
    assert asked == [{}, {"compiler_options": long_programs.OPTIONS}, {"static_argnums": 0}]
