"""The first layer in JAX's default precision: each number is that of 64 bits within what rounding explains."""

import inspect
import json
import sys
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import first_layer_cases
import inertiax
from hard_limit import run_here
from inertiax.numerics.wide_arithmetic import in_64_bits


CASES = first_layer_cases.CASES


def _members(name: str, value: object) -> list[str]:
    """A class's own public methods and properties."""
    found = []
    for member in dir(value):
        own = inspect.getattr_static(value, member)
        kind = property | classmethod | staticmethod
        if member.startswith("_") and member != "__call__":
            continue
        if inspect.isfunction(own) or isinstance(own, kind):
            found.append(f"{name}.{member}")
    return found


def _layer(home: object, inside: str = "inertiax", prefix: str = "") -> set[str]:
    """Every public name of a module that comes from `inside`, with the members of its classes."""
    found: set[str] = set()
    for name in dir(home):
        value = getattr(home, name)
        own = str(getattr(value, "__module__", "")).startswith(inside)
        if name.startswith("_") or not own or not callable(value):
            continue
        found.add(prefix + name)
        if inspect.isclass(value):
            found |= set(_members(prefix + name, value))
    return found


def test_every_name_is_in_the_table():
    layer = _layer(inertiax)
    layer |= _layer(inertiax.navigation, "inertiax.navigation", "navigation.")
    layer |= _layer(inertiax.sources, "inertiax.analysis.sources", "sources.")
    rows = {name for case in CASES for name in case.covers}
    listed = rows | first_layer_cases.WITHOUT_NUMBERS
    assert layer - listed == set(), "add a case to tests/first_layer_cases.py"
    assert {n for n in listed if " " not in n} - layer == set()


def _in(bits: int) -> list[object]:
    """Each case's numbers, or the error, in a precision."""
    code = "import first_layer_cases\nfirst_layer_cases.main()"
    # Warnings are errors here, as of numbers that are cut to 32 bits.
    said = run_here(code, seconds=600.0, wide=bits == 64).splitlines()
    assert len(said) == len(CASES)
    return [json.loads(line) for line in said]


@pytest.fixture(scope="module")
def found():
    """Each case's numbers in 32 and in 64 bits.

    In one process, where what is computed in 64 bits whatever JAX is set to is traced and compiled once.
    """
    return list(zip(_in(32), _in(64)))


def _values_kept(module: ModuleType) -> list[object]:
    """What a module and its classes hold."""
    own = [v for v in vars(module).values() if inspect.isclass(v)]
    return [v for holder in (module, *own) for v in vars(holder).values()]


def test_no_number_is_kept_in_the_precision_that_it_was_first_asked_for_in():
    """So that a process may ask in both: none of the package's modules holds an array of JAX."""
    ours = [m for name, m in sys.modules.items() if name.split(".")[0] == "inertiax"]
    assert len(ours) > 100
    held = [(m.__name__, v) for m in ours for v in _values_kept(m) if isinstance(v, jax.Array)]
    assert not held


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(CASES)), ids=lambda k: CASES[k].covers[0])
def test_32_bits_give_the_numbers_of_64(found, number):
    narrow, wide = found[number]
    assert not isinstance(wide, str), wide
    assert not isinstance(narrow, str), narrow
    assert [len(x) for x in narrow] == [len(x) for x in wide]
    for ours, right in zip(narrow, wide):
        largest = np.max(np.abs(right), initial=0.0)
        np.testing.assert_allclose(
            ours, right, rtol=0.0, atol=CASES[number].tolerance * largest + 1e-30
        )


@pytest.mark.slow
def test_600_m_are_600_m(found):
    """The navigator in 32 bits against the path itself in 64."""
    runs = [(c, f) for c, f in zip(CASES, found) if c.covers[0].startswith("600 m")]
    assert len(runs) == 3
    for case, (narrow, wide) in runs:
        went, truth = np.array(narrow[0]), np.array(wide[1])
        assert np.linalg.norm(truth) > 500.0
        # The midpoint rule leaves out (Δψ)²/24 of a step's turn Δψ, 1e-5 of the way at 1 Hz.
        assert np.linalg.norm(went - truth) < 0.1, case.covers[0]


def test_what_needs_64_bits_says_so_in_traced_code():
    narrow = jnp.ones(2, jnp.float32)
    assert in_64_bits("sine(x)", jnp.sin, narrow).dtype == np.float64
    with pytest.raises(ValueError, match=r"`sine\(x\)` needs 64 bits and was traced in 32"):
        jax.jit(lambda x: in_64_bits("sine(x)", jnp.sin, x))(narrow)
