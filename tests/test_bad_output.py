"""A result is there whole or not at all: the disk is full, the run is killed, two runs end together."""

import os
import re
import signal
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

from bad_inputs_cases import good_calibration, rests, TABLE, TOML
from command_runs import run_in
from inertiax.cli.outputs import staged_folder


posix = pytest.mark.skipif(os.name != "posix", reason="limits and signals of POSIX")


def python(code: str, *arguments: object, limit: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Code in a process of its own, without the compilation cache."""
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": ""}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=limit, env=environment)


# Files may not grow beyond 4 kB: what a write meets in the middle on a full disk. Python would keep compiled modules
# that are cut off there.
FULL = """
import resource, signal, sys
sys.dont_write_bytecode = True
from inertiax.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
for output in sys.argv[3:]:
    try:
        main(["compensate", *sys.argv[1:3], "-o", output])
    except SystemExit as end:
        assert end.code == 1
"""


@pytest.mark.slow
@posix
def test_a_disk_that_is_full_leaves_what_was_there(tmp_path):
    columns = {"time": 0.01 * np.arange(5000)}
    columns |= {f"accel_{a}": np.random.default_rng(0).standard_normal(5000) for a in "xyz"}
    pl.DataFrame(columns).write_csv(tmp_path / "a.csv")
    (tmp_path / "c.json").write_bytes(good_calibration(thermal=False))
    results = [tmp_path / "out.csv", tmp_path / "out.parquet"]
    for result in results:
        result.write_text("earlier")
    done = python(FULL, tmp_path / "c.json", tmp_path / "a.csv", *results)
    assert done.returncode == 0 and done.stdout == ""
    said = [f"inertiax: {result}: cannot be written: File too large." for result in results]
    assert done.stderr.splitlines() == said
    assert {result.read_text() for result in results} == {"earlier"}
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "c.json", "out.csv", "out.parquet"}


@posix
def test_a_run_that_is_killed_before_it_renames_leaves_the_earlier_result(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "calibration.json").write_text("earlier")
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom inertiax.cli.outputs import staged_folder\n"
        "with staged_folder(Path(sys.argv[1])) as staging:\n"
        "    (staging / 'calibration.json').write_text('new')\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    assert python(code, tmp_path / "out").returncode == -signal.SIGKILL
    assert (tmp_path / "out" / "calibration.json").read_text() == "earlier"
    with staged_folder(tmp_path / "out") as staging:
        (staging / "calibration.json").write_text("next")
    assert (tmp_path / "out" / "calibration.json").read_text() == "next"


@posix
def test_a_file_that_is_killed_before_its_rename_is_the_earlier_one(tmp_path):
    (tmp_path / "a.json").write_text("earlier")
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom inertiax.storage.whole_files import write_atomically\n"
        "os.replace = lambda a, b: os.kill(os.getpid(), 9)\n"
        "write_atomically(Path(sys.argv[1]), b'new')\n"
    )
    assert python(code, tmp_path / "a.json").returncode == -signal.SIGKILL
    assert (tmp_path / "a.json").read_text() == "earlier"


INTO = """
import sys
from contextlib import ExitStack
from pathlib import Path
from inertiax.cli.outputs import staged_folder
with ExitStack() as stack:
    for name in sys.argv[1:]:
        staging = stack.enter_context(staged_folder(Path(name)))
        for k in range(300):
            (staging / f"{k}.txt").write_text("a")
    print("written", flush=True)
    sys.stdin.readline()
"""


@pytest.mark.slow
@posix
def test_of_two_runs_into_one_folder_one_is_refused_in_a_line(tmp_path):
    """Into a folder that is there and into one that is not."""
    folders = [tmp_path / "there" / "out", tmp_path / "not" / "out"]
    folders[0].mkdir(parents=True)
    folders[1].parent.mkdir()
    command = [sys.executable, "-c", INTO, *map(str, folders)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    refused = []
    with subprocess.Popen(command, **pipes) as first:
        assert first.stdout.readline() == "written\n"
        for folder in folders:
            with pytest.raises(ValueError) as caught, staged_folder(folder) as staging:
                (staging / "0.txt").write_text("b")
            refused.append(str(caught.value))
        first.communicate("\n")
    assert first.returncode == 0
    said = f"out: another run \\(process {first.pid} on .+\\) writes there; let it end, or [^\n]+"
    assert all(re.search(f"{said}$", line) and "\n" not in line for line in refused)
    for folder in folders:
        found = sorted(folder.iterdir())
        assert len(found) == 300
        assert {p.read_text() for p in found} == {"a"}
        assert [p.name for p in folder.parent.iterdir()] == ["out"]


HOSTILE = "<img src=x onerror=alert(1)>\"'&</script><script>alert(2)</script>"


@pytest.mark.slow
@pytest.mark.parametrize("command", ["calibrate", "fleet"])
def test_markup_in_a_serial_number_stays_text_in_every_page(tmp_path, monkeypatch, capfd, command):
    # Of a fleet, the page names devices that were set aside: this one has too few positions.
    tables = (
        {HOSTILE: rests(4), "B": TABLE, "C": rests(seed=2)}
        if command == "fleet"
        else {HOSTILE: TABLE}
    )
    table = pl.concat([t.with_columns(device=pl.lit(n)) for n, t in tables.items()])
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "campaign.toml").write_text(TOML)
    table.write_parquet(tmp_path / "c" / "a.parquet")
    status, _, err = run_in(f"{command} @c -o @out", tmp_path, capfd, monkeypatch)
    assert status == 0, err
    pages = [p.read_text() for p in (tmp_path / "out").rglob("*.html")]
    assert pages and any("&lt;img" in page for page in pages)
    for page in pages:
        assert (
            "<img src=x" not in page
            and "<script>alert" not in page
            and "</script><script>" not in page
        )
    pictures = [p.read_text() for p in (tmp_path / "out").rglob("*.svg")]
    assert not any("<img" in picture or "<script" in picture for picture in pictures)
    assert {p.name for p in tmp_path.iterdir()} == {"c", "out"}
