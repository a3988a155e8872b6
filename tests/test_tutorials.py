"""Tutorials are walked as a reader would: files are saved by their titles, commands typed, outputs compared.

A fenced block with a title is a file. Of a `console` block, lines that begin with `$ ` are commands and the others
what they print; a line `…` stands for lines left out. Other Python blocks of a page are one script.
"""

import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from command_runs import run_in
from hard_limit import run_here


DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', flags=re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
# Pages with commands, and pages whose Python runs.
WALKED = ("hand-log", "chamber-table", "fleet")
SCRIPTS = ("own-model", "navigation", "navigation-filter", "twin")


def _blocks(page: str) -> list[tuple[str, str, str]]:
    return BLOCK.findall((DOCS / "tutorials" / f"{page}.md").read_text(encoding="utf-8"))


def _steps(console: str) -> list[tuple[str, list[str]]]:
    """Commands of a block, each with the lines that it prints."""
    lines = console.splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("$ ")]
    assert starts and starts[0] == 0
    return [(lines[a][2:], lines[a + 1 : b]) for a, b in pairwise([*starts, len(lines)])]


def _run(command: str, folder: Path, capfd) -> str:
    """What a command prints; inertiax and Python in this process, which has imported and compiled most already."""
    # Wide enough that tables and messages are not broken differently from the page.
    wide = {"COLUMNS": "1000", "MPLBACKEND": "Agg"}
    program, *arguments = command.split()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in wide.items():
            patch.setenv(name, value)
        if program == "inertiax":
            capfd.readouterr()
            status, said, err = run_in(" ".join(arguments), folder, capfd, patch)
            assert status == 0, (command, err[-2000:])
            return said
        if program == "python":
            patch.chdir(folder)
            patch.setattr(sys, "argv", arguments)
            code = f"import runpy\nrunpy.run_path({arguments[0]!r}, run_name='__main__')"
            return run_here(code, seconds=600.0, wide=False)
    made = subprocess.run(
        command,
        shell=True,
        cwd=folder,
        env=os.environ | wide,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert made.returncode == 0, (command, made.stderr[-2000:])
    return made.stdout


def _agree(shown: str, printed: str) -> bool:
    """The words are equal, and numbers within 2 % or two units of the last digit shown.

    Compilers add up in another order on another processor; a search then ends a hair beside.
    """
    a, b = NUMBER.findall(shown), NUMBER.findall(printed)
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split() or len(a) != len(b):
        return False
    for x, y in zip(a, b, strict=True):
        decimals = len(x.partition("e")[0].partition(".")[2])
        unit = 10.0**-decimals * (10.0 ** int(x.partition("e")[2]) if "e" in x else 1.0)
        if abs(float(x) - float(y)) > max(0.02 * abs(float(x)), 2.0 * unit):
            return False
    return True


def _missing(shown: list[str], printed: str) -> list[str]:
    """Lines of the page that the command did not print, in this order."""
    left, missing = printed.splitlines(), []
    for line in (s for s in shown if s.strip() != "…"):
        found = next((k for k, p in enumerate(left) if _agree(line, p)), None)
        if found is None:
            missing.append(line)
        else:
            left = left[found + 1 :]
    return missing


@pytest.mark.slow
@pytest.mark.parametrize("page", WALKED)
def test_walk(page, tmp_path, capfd):
    (tmp_path / "docs").symlink_to(DOCS)
    for kind, title, text in _blocks(page):
        if title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif kind == "console":
            for command, shown in _steps(text):
                printed = _run(command, tmp_path, capfd)
                assert not _missing(shown, printed), (command, printed)
    if page == "hand-log" and shutil.which("gcc"):
        subprocess.run(
            ["gcc", "-std=c99", "-fsyntax-only", "imu_calibration.h"], cwd=tmp_path, check=True
        )


# In JAX's defaults, as a reader runs it: 32 bits, but where the page asks for 64. What the pages call gives the numbers
# of 64 bits by `test_first_layer_precision.py`, and the other tests run it in 64.
@pytest.mark.slow
@pytest.mark.parametrize("page", SCRIPTS)
def test_script_in_the_default_precision(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "\n".join(text for kind, title, text in _blocks(page) if kind == "python" and not title)
    printed = run_here(code, seconds=600.0, wide=False)
    shown = [
        line for kind, _, text in _blocks(page) if kind == "text" for line in text.splitlines()
    ]
    assert not _missing(shown, printed), printed


def test_outputs_are_compared_by_words_and_numbers():
    assert _agree("bias x  0.34995  m/s²", "bias x 0.3500   m/s²")
    assert not _agree("bias x 0.34995 m/s²", "bias y 0.34995 m/s²")
    assert not _agree("time 238 s", "time 250 s")
    assert _missing(["a 1", "…", "c 3"], "a 1\nb 2\nc 3\n") == []
    assert _missing(["c 3", "a 1"], "a 1\nb 2\nc 3\n") == ["a 1"]


def test_every_tutorial_is_tried():
    # `concealed-effect` by `test_add_an_effect.py`.
    pages = {p.stem for p in (DOCS / "tutorials").glob("*.md")}
    assert pages == {*WALKED, *SCRIPTS, "concealed-effect"}
