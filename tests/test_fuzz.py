"""Readers meet bytes that nobody wrote: what fuzzing found, and random damage of small valid files."""

import random
from pathlib import Path

import pytest


for library in ("h5py", "pyulog", "rosbags"):
    pytest.importorskip(library, reason="inertiax[formats] is not installed")

from hypothesis import given, HealthCheck, settings, strategies as st  # noqa: E402

from fuzz.mutate import change_of, of_bytes  # noqa: E402
from fuzz.targets import attempt, prepare, TARGETS  # noqa: E402


CORPUS = sorted((Path(__file__).parent / "fuzz" / "corpus").glob("*/*"))


@pytest.mark.parametrize("file", CORPUS, ids=lambda f: f"{f.parent.name}-{f.name}")
def test_what_fuzzing_found_is_read_or_refused_in_one_line(file, tmp_path, capfd):
    target = TARGETS[file.parent.name]
    prepare(target, tmp_path)
    attempt(target, tmp_path, file.read_bytes())
    assert capfd.readouterr() == ("", "")


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Each reader's folder and seeds, made when it is first used."""
    made = {}

    def place(name):
        if name not in made:
            folder = tmp_path_factory.mktemp(name)
            prepare(TARGETS[name], folder)
            made[name] = folder, TARGETS[name].seeds()
        return made[name]

    return place


@pytest.mark.parametrize("name", TARGETS)
def test_small_valid_files_are_taken(name, places):
    folder, seeds = places(name)
    assert attempt(TARGETS[name], folder, seeds[0]) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
# The same damage every time: a change is judged by what it does; `fuzz.drive` looks for new damage.
@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    database=None,
    derandomize=True,
)
@given(seed=st.integers(0, 2**32), deep=st.booleans())
def test_damage_is_refused_in_one_line(name, places, seed, deep):
    folder, seeds = places(name)
    target, chance = TARGETS[name], random.Random(seed)
    change = change_of(target.file) if deep else of_bytes
    attempt(target, folder, change(chance.choice(seeds), chance))
