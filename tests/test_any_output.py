"""Standard output of any encoding takes results; names in files steer no terminal, wherever they are shown."""

import ast
import contextlib
import io
import json
import os
import pty
import subprocess
import sys
import threading
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
from rich.table import Table

import inertiax
from bad_inputs_cases import CSV, TABLE, TOML
from command_runs import draw_here
from inertiax.cli import console, main
from inertiax.cli.streams import AnyText
from inertiax.data.campaign import load_campaign
from inertiax.report.terminal import Terminal


EVIL = "\x1b]0;owned\x07\x1b[2J\u202edevice\x9b31m"


def campaign(folder: Path, device: str | None = None) -> Path:
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(TOML)
    if device is None:
        (folder / "a.csv").write_text(CSV)
    else:
        TABLE.with_columns(device=pl.lit(device)).write_parquet(folder / "a.parquet")
    return folder


def command(*arguments: object, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "inertiax", *map(str, arguments)],
        capture_output=True, timeout=240, env={**os.environ, **environment},
    )  # fmt: skip


# The table in one encoding that has "ä" and no "σ", and the document in one that has neither: the stream between is
# one for both, and a process's standard output is opened with the encoding before the command has a say.
@pytest.mark.slow
@pytest.mark.parametrize(("encoding", "json_asked"), [("cp1252", False), ("ascii", True)])
def test_results_reach_standard_output_in_any_encoding(tmp_path, encoding, json_asked):
    folder = campaign(tmp_path / "c", "Gerät σ 7")
    asked = ["--json"] if json_asked else []
    done = command("calibrate", folder, "-o", tmp_path / "o", *asked, PYTHONIOENCODING=encoding)
    assert done.returncode == 0, done.stderr
    said = done.stdout.decode(encoding)
    if json_asked:
        assert "Gerät σ 7" in json.dumps(json.loads(said), ensure_ascii=False)
    else:
        assert "Gerät" in said


def test_a_stream_of_text_refuses_bytes_and_loses_no_character():
    raw = io.BytesIO()
    stream = AnyText(io.TextIOWrapper(raw, encoding="cp1252", newline=""))
    with pytest.raises(TypeError, match="str"):
        stream.write(b"")  # pyright: ignore[reportArgumentType]
    assert stream.write("µ → χ\n") == 6
    stream.flush()
    assert raw.getvalue().decode("cp1252") == "µ \\u2192 \\u03c7\n"


def test_no_escape_sequence_passes_where_text_is_written(capsys):
    console.say(EVIL)
    console.warn(EVIL)
    table = Table(EVIL)
    table.add_row(EVIL)
    for screen in (Terminal(), Terminal(stderr=True)):
        screen.print(EVIL, style="bold")
        screen.print(table)
    with console.Stages(quiet=False) as stages:
        stages.note(EVIL)
        stages(EVIL)
    said = capsys.readouterr()
    for text in (said.out, said.err):
        assert "device" in text
        assert all(c.isprintable() or c == "\n" for c in text)


def seen_on_a_terminal(commands: list[list[str]], monkeypatch) -> str:
    """What commands write to a terminal, standard output and error together."""
    ours, theirs = pty.openpty()
    seen: list[bytes] = []

    def read() -> None:
        with contextlib.suppress(OSError):  # the other side is closed
            while piece := os.read(ours, 4096):
                seen.append(piece)

    reader = threading.Thread(target=read)
    reader.start()
    with open(theirs, "w", encoding="utf-8") as screen, monkeypatch.context() as set_here:
        set_here.setattr(sys, "stdout", screen)
        set_here.setattr(sys, "stderr", screen)
        for arguments in commands:
            with pytest.raises(SystemExit) as end:
                main(arguments)
            assert not end.value.code
    reader.join(60)
    os.close(ours)
    return b"".join(seen).decode()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="terminals of POSIX")
def test_a_device_of_escape_sequences_steers_no_terminal(tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    monkeypatch.setenv("TERM", "xterm")
    draw_here(monkeypatch)
    folder, names = str(campaign(tmp_path / "c", EVIL)), ("calibrate", "fleet")
    asked = [[name, folder, "-o", str(tmp_path / name)] for name in names]
    seen = seen_on_a_terminal(asked, monkeypatch)
    assert "\x1b[" in seen  # as on a terminal
    for name in names:
        assert f"{name}/report.html" in seen
    for sequence in ("\x1b]", "\x07", "\x1b[2J", "\u202e", "\x9b"):
        assert sequence not in seen
    for name in names:  # and on a pipe, which is no terminal
        with pytest.raises(SystemExit):
            main([name, folder, "-o", str(tmp_path / f"{name}-2")])
        said = capfd.readouterr()
        assert said.out and all(c.isprintable() or c == "\n" for c in said.out + said.err)


# In an encoding of single bytes such as cp1252 each byte is a letter, and every name a text.
linux = pytest.mark.skipif(
    sys.platform != "linux" or os.fsdecode(b"\xff").isprintable(), reason="file names of any bytes"
)


@linux
@pytest.mark.parametrize(
    "name", ["calibrate", "compensate", "noise", "fleet", "diagnose", "protocol"]
)
def test_paths_that_are_no_utf_8_are_refused_in_one_line(tmp_path, name, capfd):
    inside = os.fsdecode(os.fsencode(tmp_path) + b"/c\xff\xfe")
    os.mkdir(inside)
    arguments = [name, inside, "-o", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as exit:
        main(arguments)
    said = capfd.readouterr().err
    assert exit.value.code == 2
    assert (
        said
        == f"inertiax: Invalid value: '{tmp_path}/c��' is no UTF-8; rename it. See `inertiax --help`.\n"
    )


@linux
def test_a_recording_whose_name_is_no_utf_8_is_refused_in_one_line(tmp_path):
    folder = campaign(tmp_path / "c")
    (folder / "campaign.toml").write_text(TOML.replace("a.*", "*"))
    os.rename(folder / "a.csv", os.fsencode(folder) + b"/a\xff.csv")
    with pytest.raises(ValueError, match=r"the name of 'a�.csv' is no UTF-8; rename it") as caught:
        load_campaign(folder)
    assert "\n" not in str(caught.value)


def test_only_the_console_writes_to_standard_output():
    """Every other module of the command line speaks through it, where text of files is made harmless."""
    home = Path(inertiax.__file__).parent
    for file in sorted((home / "cli").glob("*.py")):
        if file.name in ("console.py", "streams.py", "interrupts.py"):
            continue
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                if called == "print" and file.name in ("app.py", "outputs.py"):
                    continue  # messages made one line there; JSON, which escapes what does not print
                assert called not in ("print", "typer.echo", "sys.stdout.write"), (
                    file.name,
                    node.lineno,
                )


def test_numbers_that_are_not_finite_are_null_on_standard_output(capsys):
    from inertiax.cli import outputs

    outputs.print_json({"a": float("nan"), "b": [np.inf, 1.5]})
    assert msgspec.json.decode(capsys.readouterr().out) == {"a": None, "b": [None, 1.5]}
