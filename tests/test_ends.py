"""A command that is interrupted says so in one line, with the status that a shell expects, and leaves nothing."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from inertiax.fleet import cluster


pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


@pytest.fixture(autouse=True, scope="module")
def _signals_as_a_terminal_leaves_them():
    """Under nohup, or in the background of a shell, this process ignores some, and what it starts would too."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        one: signal.signal(one, usual)
        for one, usual in (
            (signal.SIGINT, signal.default_int_handler),
            (signal.SIGHUP, signal.SIG_DFL),
        )
    }
    yield
    for one, handler in before.items():
        signal.signal(one, handler)


# A run that is at work in its folder: staging, a half-written file, a child and threads beside it.
AT_WORK = """
import multiprocessing, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from inertiax.cli.interrupts import handled, held_back
from inertiax.cli.outputs import staged_folder
from inertiax.storage.whole_files import written_beside

def child():
    print("ready", flush=True)
    time.sleep(100)

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with handled(), staged_folder(folder) as staging, written_beside(staging / "a") as beside:
        beside.write_text("half")
        context = multiprocessing.get_context("spawn")
        context.Process(target=child).start()
        with ThreadPoolExecutor(2) as pool:
            pool.submit(time.sleep, 100)
            time.sleep(100)
"""


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (signal.SIGINT, "interrupted"),
        (signal.SIGTERM, "terminated"),
        (signal.SIGHUP, "the terminal is gone"),
    ],
)
def test_a_signal_ends_a_run_in_one_line_and_leaves_nothing(tmp_path, sent, words):
    (tmp_path / "main.py").write_text(AT_WORK)
    run = start([tmp_path / "main.py", tmp_path / "out"])
    assert run.stdout.readline() == "ready\n"
    run.send_signal(sent)
    # The child and the thread would sleep for longer than this: who waits for them to end fails here.
    _, said = run.communicate(timeout=60)
    assert said == f"inertiax: {words}.\n"
    assert run.returncode == 128 + sent
    assert [p.name for p in tmp_path.iterdir()] == ["main.py"]


def test_a_signal_waits_for_steps_that_belong_together(tmp_path):
    code = """
import os, signal, sys
from pathlib import Path
from inertiax.cli.interrupts import handled, held_back
with handled():
    with held_back():
        os.kill(os.getpid(), signal.SIGTERM)
        Path(sys.argv[1]).write_text("whole")
    Path(sys.argv[1]).write_text("too late")
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a"], capture_output=True)
    assert done.returncode == 128 + signal.SIGTERM
    assert (tmp_path / "a").read_text() == "whole"


def test_signals_that_are_ignored_stay_so_and_handlers_come_back():
    code = """
import os, signal
from inertiax.cli.interrupts import handled
signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
with handled():
    os.kill(os.getpid(), signal.SIGHUP)
    assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
print(signal.getsignal(signal.SIGTERM) is signal.SIG_DFL, signal.getsignal(signal.SIGINT).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "True default_int_handler\n", done.stderr


def test_the_command_itself_is_handled_before_anything_large_is_loaded(tmp_path):
    """Ctrl-C while `inertiax --help` still imports."""
    code = """
import os, signal, sys
sys.path_hooks.insert(0, lambda path: (_ for _ in ()).throw(ImportError))
class Meta:
    def find_spec(self, name, path, target=None):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Meta())
from inertiax.cli import main
main(["--help"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "inertiax: interrupted.\n")


@pytest.mark.slow
def test_a_reader_that_leaves_is_no_error(tmp_path):
    """`inertiax … | head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    run = subprocess.run(
        [sys.executable, "-m", "inertiax", "export", "--list"],
        stdout=writing, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    os.close(writing)
    assert (run.returncode, run.stderr) == (1, "")


def start(arguments: list[Path]) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_pythons_own_tracker_is_started_silent(monkeypatch):
    """It outlives a run that Ctrl-C ends, and would warn of the run's semaphores beside its one line."""
    seen = []
    monkeypatch.setattr(
        cluster.resource_tracker,
        "ensure_running",
        lambda: seen.append(os.environ["PYTHONWARNINGS"]),
    )
    monkeypatch.setenv("PYTHONWARNINGS", "error")
    cluster._start_tracker()
    assert seen == ["error,ignore:resource_tracker"] and os.environ["PYTHONWARNINGS"] == "error"
    monkeypatch.delenv("PYTHONWARNINGS")
    cluster._start_tracker()
    assert seen[1] == "ignore:resource_tracker" and "PYTHONWARNINGS" not in os.environ
