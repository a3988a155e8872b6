"""Readers meet bytes that nobody wrote: what fuzzing found, and random damage of small valid files."""

import random
from pathlib import Path

import pytest


for library in ("h5py", "pyulog", "rosbags"):
    pytest.importorskip(library, reason="inertiax[formats] is not installed")

from hypothesis import given, HealthCheck, settings, strategies as st  # noqa: E402

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


@st.composite
def damage(draw):
    """A function of bytes: cut, change, repeat or insert a few."""
    chance = random.Random(draw(st.integers(0, 2**32)))
    words = (
        b"\xff" * 4,
        b"\0" * 8,
        b"nan",
        b"1e999",
        b'"',
        b"[" * 500,
        b"{" * 500,
        b"-1",
        b"\n",
        b"\x1b[2J",
    )

    def apply(content):
        changed = bytearray(content)
        for _ in range(chance.choice((1, 1, 2, 8, 40))):
            at = chance.randrange(len(changed) or 1)
            match chance.randrange(5):
                case 0:
                    del changed[at : at + chance.choice((1, 4, 100, 10**6))]
                case 1:
                    changed[at : at + 1] = bytes([chance.randrange(256)])
                case 2:
                    changed[at:at] = chance.choice(words)
                case 3:
                    changed[at:at] = changed[at // 2 : at // 2 + 64]
                case _:
                    changed[at : at + 4] = chance.randbytes(4)
        return bytes(changed)

    return apply


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(change=damage())
def test_damage_is_refused_in_one_line(name, places, change):
    folder, seeds = places(name)
    for seed in seeds[:1]:
        attempt(TARGETS[name], folder, change(seed))
