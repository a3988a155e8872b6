"""Commands run in this process: status, standard output and error.

Here they draw their figures themselves: a process of its own would import matplotlib anew, for half a second each.
"""

import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from inertiax.cli import main
from inertiax.plots.style import Forms


UNDRAWN = Forms("<svg ></svg>", b"", 1.0)


def draw_here(monkeypatch) -> None:
    """Have figures drawn by this process."""
    aside = "inertiax.plots.figure_workers.drawn_aside"
    monkeypatch.setattr(aside, lambda module, *, several: nullcontext())


def draw_nothing(monkeypatch) -> None:
    """Have pages made without figures, where nobody looks at them."""
    monkeypatch.setattr("inertiax.report.page.both_forms", lambda figure: UNDRAWN)


def place(folder: Path, files: dict) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())


def run_in(arguments: str, folder: Path, capfd, monkeypatch) -> tuple[int, str, str]:
    """Status, standard output and error of a command, with the case's folder called HERE."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    filled = [a.replace("@", f"{folder}/", 1) if a[0] == "@" else a for a in arguments.split()]
    monkeypatch.setattr(sys, "argv", ["inertiax", *filled])
    draw_here(monkeypatch)
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as exit:
        main(filled)
    said = capfd.readouterr()
    return int(exit.value.code or 0), said.out, said.err.replace(str(folder), "HERE")


def run(capsys, monkeypatch, *arguments) -> tuple[int, str, str]:
    """Status, standard output and standard error of one command."""
    # With this set the command leaves JAX's cache alone, which the other tests share.
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    arguments = [str(a) for a in arguments]
    monkeypatch.setattr(sys, "argv", ["inertiax", *arguments])
    draw_here(monkeypatch)
    with pytest.raises(SystemExit) as exit:
        main(arguments)
    said = capsys.readouterr()
    return int(exit.value.code or 0), said.out, said.err
