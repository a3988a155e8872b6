"""A process that diagnoses hundreds of campaigns lets compiled programs go in time."""

import json
import mmap
import pathlib
import platform

import jax
import numpy as np
import pytest

from hard_limit import run_limited
from inertiax.data.recording import Campaign
from inertiax.diagnose import problem as engine
from inertiax.numerics import compilation_cache as programs


@pytest.fixture
def doubled():
    """A compiled function of its own, with what counts its programs."""
    double = jax.jit(lambda x: 2.0 * x)
    double(np.ones(3))
    assert double._cache_size() == 1
    return double


def told(folder: pathlib.Path, used: int, granted: str) -> tuple[pathlib.Path, pathlib.Path]:
    areas, limit = folder / "maps", folder / "max_map_count"
    areas.write_text("7f00-7f01 r-xp 00000000 00:00 0\n" * used)
    limit.write_text(granted)
    return areas, limit


def test_nothing_is_cleared_up_to_half_of_what_is_granted(tmp_path, doubled):
    assert not programs.make_room(*told(tmp_path, 50, "100\n"))
    assert doubled._cache_size() == 1


@pytest.mark.parametrize("granted", ["", "unlimited\n"])
def test_a_system_that_does_not_say_is_left_alone(tmp_path, doubled, granted):
    assert not programs.make_room(*told(tmp_path, 51, granted))
    assert not programs.make_room(tmp_path / "nothing", tmp_path / "nowhere")
    assert doubled._cache_size() == 1


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library than glibc")
def test_freed_memory_goes_back_to_the_system(tmp_path):
    def resident() -> int:
        return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE

    pieces = [
        np.ones(10_000) for _ in range(2_000)
    ]  # 160 MB, each too small for an area of its own
    del pieces[:-1]
    before = resident()
    programs.make_room(*told(tmp_path, 50, "100\n"))
    assert before - resident() > 120e6


# In a process of its own: what the other tests have compiled stays with them.
CLEARED = """
import json
from pathlib import Path
from inertiax.numerics.compilation_cache import AREAS, make_room

areas = lambda: len(AREAS.read_text().splitlines()) if AREAS.exists() else 0
double = jax.jit(lambda x: 2.0 * x)
double(np.ones(3))
begun = areas()
kept = [jax.jit(lambda x, k=k: jnp.sin(x) ** k) for k in range(40)]
for k, function in enumerate(kept, start=1):
    function(np.ones(k))
full = areas()
cleared = make_room(Path({areas!r}), Path({limit!r}))
print(json.dumps([cleared, double._cache_size(), begun, full, areas(), double(np.ones(3)).tolist()]))
"""


@pytest.mark.slow
def test_programs_go_beyond_half_give_their_areas_back_and_come_back_when_called(tmp_path):
    areas, limit = (str(p) for p in told(tmp_path, 51, "100\n"))
    said = run_limited(CLEARED.format(areas=areas, limit=limit), seconds=240.0)
    cleared, programs_left, begun, full, after, answer = json.loads(said)
    assert cleared and programs_left == 0 and answer == [2.0, 2.0, 2.0]
    if programs.AREAS.exists():
        assert full > begun + 40
        assert after - begun < 0.5 * (full - begun)


def test_every_diagnosis_of_a_campaign_looks_first(monkeypatch):
    class Looked(Exception):
        pass

    def look():
        raise Looked

    monkeypatch.setattr(engine, "make_room", look)
    with pytest.raises(Looked):
        engine.prepare(object.__new__(Campaign))
