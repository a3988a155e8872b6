"""Files are whole, folders have one owner, and text of files steers no terminal."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hard_limit import ends_within
from inertiax.storage.harmless_text import harmless, one_line, short
from inertiax.storage.ownership import owned
from inertiax.storage.whole_files import (
    scratch_folder,
    sweep,
    sweep_own,
    unfinished_folder,
    unfinished_name,
    write_atomically,
    written_beside,
)


posix = pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")


@pytest.mark.slow
@pytest.mark.parametrize(
    "evil",
    [
        "\x1b[31mred",  # colour
        "\x1b]0;title\x07",  # a window's title
        "\x1b]52;c;cm0gLXJm\x07",  # the clipboard
        "\x9b31m",  # the one-byte form of escape [
        "a\x08\x08b",  # overwrites what is before
        "\u202egnp.exe",  # writes from right to left
        "\x00",
        "\udcff",  # half of a surrogate pair: a byte that is no UTF-8
        "\u2028",  # a line separator
    ],
)
def test_no_command_to_a_terminal_is_left_in_a_text(evil):
    for made in (harmless(evil), one_line(evil), short(evil)):
        assert all(c.isprintable() for c in made)
        made.encode("utf-8")


def test_layout_of_tables_stays():
    assert harmless("a\tb\nc µm/s² → χ²") == "a\tb\nc µm/s² → χ²"


def test_a_name_of_thousands_of_letters_is_cut_and_a_path_is_not():
    assert one_line(f"device '{'A' * 5000}': too few") == f"device '{'A' * 39}… too few"
    path = "/".join(["folder-of-a-test"] * 20)
    assert one_line(f"{path}: no rows") == f"{path}: no rows"
    assert len(one_line("word " * 5000)) < 2100
    assert len(short("A" * 5000)) == 41


def test_a_file_is_whole_and_as_readable_as_others(tmp_path):
    write_atomically(tmp_path / "deep" / "a.json", b"{}")
    plain = tmp_path / "plain"
    plain.write_bytes(b"")
    assert (tmp_path / "deep" / "a.json").read_bytes() == b"{}"
    assert (tmp_path / "deep" / "a.json").stat().st_mode == plain.stat().st_mode
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["a.json"]


def test_a_write_that_fails_leaves_what_was_there(tmp_path):
    (tmp_path / "a").write_text("earlier")
    with pytest.raises(RuntimeError):
        with written_beside(tmp_path / "a") as beside:
            beside.write_text("half")
            raise RuntimeError
    assert (tmp_path / "a").read_text() == "earlier"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_process_that_ends_sweeps_what_it_has_not_finished_and_nothing_else(tmp_path):
    (tmp_path / ".inertiax-of-another~1").write_text("")
    with unfinished_folder(tmp_path, "out") as folder, written_beside(folder / "a") as beside:
        beside.write_text("half")
        sweep_own()
        assert [p.name for p in tmp_path.iterdir()] == [".inertiax-of-another~1"]
        beside.parent.mkdir()
        beside.write_text("half")  # so that its rename finds it


def test_names_of_the_greatest_length_are_written(tmp_path):
    write_atomically(tmp_path / ("a" * 240), b"1")
    assert [p.name for p in tmp_path.iterdir()] == ["a" * 240]


def test_an_owner_sweeps_what_a_killed_run_left_of_the_same_results_only(tmp_path):
    left = tmp_path / f"{unfinished_name(tmp_path / 'out')}1-2-3"
    other = tmp_path / f"{unfinished_name(tmp_path / 'out-2')}1-2-3"
    for folder in (left, other, tmp_path / "out" / "parts"):
        folder.mkdir(parents=True)
    (tmp_path / "out" / "parts" / ".inertiax-part-0.parquet~7-8-9").write_text("half")
    (tmp_path / "out" / ".inertiax-summary.json~7-8-9").write_text("half")
    (tmp_path / "out" / "parts" / "part-1.parquet").write_text("whole")
    with owned(tmp_path / "out"):
        assert not left.exists() and other.exists()
    there = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*"))
    assert there == [other.name, "out", "out/parts", "out/parts/part-1.parquet"]


def test_a_sweep_is_of_unfinished_names_only(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(AssertionError):
        sweep(tmp_path, "")
    assert (tmp_path / "a").exists()


def test_folders_above_are_made_and_taken_back_where_nothing_was_written(tmp_path):
    with owned(tmp_path / "a" / "b" / "out"):
        assert (tmp_path / "a" / "b").is_dir()
    assert not list(tmp_path.iterdir())
    with owned(tmp_path / "a" / "out"):
        write_atomically(tmp_path / "a" / "out", b"1")
    assert (tmp_path / "a" / "out").exists()


HOLD = """
import sys, time
from pathlib import Path
from inertiax.storage.ownership import owned
with owned(Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(100)
"""


def holder(path: Path) -> subprocess.Popen:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "mine\n"
    return process


@pytest.mark.slow
@posix
@pytest.mark.parametrize("other", ["out", "link", "sub/../out"])
def test_the_second_owner_is_refused_in_a_line_within_its_patience(tmp_path, other):
    (tmp_path / "sub").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "out")
    first = holder(tmp_path / "out")
    # The owner would hold it for 100 s: who waits for its end instead of its own patience of 2 s fails here.
    with ends_within(60.0):
        with pytest.raises(ValueError, match=f"another run \\(process {first.pid} on ") as caught:
            with owned(tmp_path / other):
                pass
    assert "\n" not in str(caught.value)
    with owned(tmp_path / "out-2"):  # other results beside them are free
        pass
    first.kill()
    first.communicate()
    with owned(tmp_path / "out"), owned(tmp_path / "out"):  # inside itself it is part of it
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "sub"]


@posix
def test_a_lock_of_a_killed_process_goes_with_the_next_run_beside_it(tmp_path):
    killed, alive = (tmp_path / f".inertiax-{n}.lock" for n in ("one", "two"))
    killed.write_text("1 elsewhere\n")  # nobody holds it
    with owned(tmp_path / "two"), owned(tmp_path / "three"):
        assert not killed.exists()
        assert alive.exists()  # held by this process
    assert not list(tmp_path.iterdir())


@posix
def test_a_lock_of_the_folder_above_stops_nobody(tmp_path):
    """`flock DIR inertiax … -o DIR/out`: whoever starts us may hold it."""
    import fcntl

    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    code = "import sys\nfrom pathlib import Path\nfrom inertiax.cli.outputs import staged_folder\n"
    code += "with staged_folder(Path(sys.argv[1])) as s: (s / 'a').write_text('1')"
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "out")], timeout=60)
    os.close(handle)
    assert done.returncode == 0 and (tmp_path / "out" / "a").exists()


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root writes everywhere")
def test_where_the_folder_above_cannot_be_written_the_lock_is_inside(tmp_path):
    out = tmp_path / "above" / "out"
    out.mkdir(parents=True)
    out.parent.chmod(0o555)
    try:
        with owned(out):
            assert len(list(out.iterdir())) == 1
        assert not list(out.iterdir())
    finally:
        out.parent.chmod(0o755)


def test_a_scratch_folder_goes_with_its_block_and_that_of_a_killed_process_with_the_next(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for process in (ended.pid, os.getpid()):
        (tmp_path / f".inertiax-scratch~{process}-x").mkdir()
    with scratch_folder() as mine:
        (mine / "a").write_text("")
        left = {p.name.split("~")[1].split("-")[0] for p in tmp_path.iterdir()} - {str(os.getpid())}
        assert left == (set() if os.name == "posix" else {str(ended.pid)})
    assert not mine.exists()
    with scratch_folder() as mine:
        sweep_own()  # what a signal's handler does
        assert not mine.exists()
