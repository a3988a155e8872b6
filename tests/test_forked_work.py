"""Work that a twin of this process does."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from inertiax.numerics import forked_work
from inertiax.numerics.forked_work import can_fork, ForkedWork


pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork"),
    # JAX warns where other tests have loaded it; the twins here do not use it.
    pytest.mark.filterwarnings("ignore:os.fork.. was called:RuntimeWarning"),
]


def test_the_answer_is_a_twins_and_holds_what_both_know_as_it_is():
    known, heard = lambda x: 2 * x, []  # which no pickle takes

    def work(say):
        say("begun")
        return os.getpid(), known, [known, b"x" * 3_000_000]

    aside = ForkedWork(work, [known])
    process, same, (again, long) = aside.result(heard.append)
    assert process != os.getpid() and heard == ["begun"]
    assert same is known and again is known and long == b"x" * 3_000_000
    aside.end()  # without effect


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is of Linux")
def test_a_twin_ends_with_the_process_that_began_it():
    code = """if True:
        import os, time
        from inertiax.numerics.forked_work import ForkedWork
        aside = ForkedWork(lambda say: (say("begun"), time.sleep(60)))
        os.read(aside._pipe, 1)  # it has begun
        print(aside._child, flush=True)
        os.kill(os.getpid(), 9)"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)
    twin = Path(f"/proc/{int(ended.stdout)}/stat")
    for _ in range(100):
        if not twin.exists() or ") Z " in twin.read_text():
            return
        time.sleep(0.05)
    pytest.fail("the twin works on")


@pytest.mark.parametrize("fate", ["dies", "cannot send", "fails", "is silent"])
def test_without_a_twins_answer_this_process_works(fate, monkeypatch):
    monkeypatch.setattr(forked_work, "LEAST", 0.2)
    monkeypatch.setattr(forked_work, "PATIENCE", 0.0)
    here = os.getpid()

    def work(say):
        if fate == "fails":
            raise ValueError("at position 7")
        if os.getpid() == here:
            return "done here"
        if fate == "dies":
            os._exit(3)
        if fate == "is silent":
            os.read(os.pipe()[0], 1)
        return lambda: None

    aside = ForkedWork(work)
    if fate == "fails":
        with pytest.raises(ValueError, match="at position 7"):
            aside.result(print)
    else:
        assert aside.result(print) == "done here"


def test_no_twin_of_a_process_with_jax():
    told = "import sys; from inertiax.numerics.forked_work import can_fork; print(can_fork())"
    before = "from inertiax.cli import environment; environment.prepare_without_jax(); "
    several = sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1
    for code, right in ((before + told, several), ("import jax; " + told, False)):
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert found.stdout.strip() == str(right), found.stderr
    import jax  # noqa: F401, as this process has it

    assert not can_fork()
