"""Readers meet bytes that nobody wrote: what fuzzing found, and random damage of small valid files."""

import random
import subprocess
import sys
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


@pytest.mark.xfail(
    strict=True, reason="polars aborts where a page of Parquet claims a run of 2^61 values"
)
def test_a_forged_run_length_in_parquet_is_refused_in_one_line():
    file = Path(__file__).parent / "fuzz" / "known" / "run-length.parquet"
    code = (
        "import sys\nfrom pathlib import Path\nfrom inertiax.formats import read_recordings\n"
        "try:\n    read_recordings(Path(sys.argv[1]))\nexcept ValueError:\n    pass\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, timeout=60)
    assert done.returncode == 0


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
