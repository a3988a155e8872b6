"""Every bad input to a command gives one line and no traceback: what, where, what would be right.

`INERTIAX_GOLDEN=write` writes the lines anew; read the difference before you commit it.
"""

import os
import sys
import time
from pathlib import Path

import pytest

from bad_inputs_cases import CASES, CSV, good_calibration, TOML
from inertiax.cli import main


GOLDEN = Path(__file__).with_name("bad_inputs.txt")
SLOWEST = 20.0  # s on the processor: no bad input is worked on for long


def place(folder: Path, files: dict) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())


def run(arguments: str, folder: Path, capfd, monkeypatch) -> tuple[int, str, str]:
    """Status, standard output and error of a command, with the case's folder called HERE."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    filled = [a.replace("@", f"{folder}/", 1) if a[0] == "@" else a for a in arguments.split()]
    monkeypatch.setattr(sys, "argv", ["inertiax", *filled])
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as exit:
        main(filled)
    said = capfd.readouterr()
    return int(exit.value.code or 0), said.out, said.err.replace(str(folder), "HERE")


def known() -> dict[str, str]:
    lines = GOLDEN.read_text("utf-8").splitlines() if GOLDEN.is_file() else []
    return dict(line.split(" | ", 1) for line in lines)


def remember(name: str, told: str) -> None:
    lines = {**known(), name: told}
    GOLDEN.write_text("".join(f"{n} | {lines[n]}\n" for n in CASES if n in lines), "utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_bad_input_is_refused_in_its_one_line(name, tmp_path, capfd, monkeypatch):
    case = CASES[name]
    good = {"good/campaign.toml": TOML, "good/a.csv": CSV, "good.csv": CSV, "good.json": GOOD}
    place(tmp_path, good)
    place(tmp_path, case.files)
    before = sorted(p for p in tmp_path.rglob("*"))
    start = time.process_time()
    status, out, err = run(case.arguments, tmp_path, capfd, monkeypatch)
    assert time.process_time() - start < SLOWEST
    assert status in (1, 2), (status, err)
    assert out == ""
    assert err.startswith("inertiax: ") and err.count("\n") == 1 and err.endswith("\n"), err
    assert "unforeseen" not in err and "Traceback" not in err
    assert len(err) < 1000 and err.rstrip("\n").isprintable(), err
    assert sorted(p for p in tmp_path.rglob("*")) == before
    told = f"{status} | {err.strip().removeprefix('inertiax: ')}"
    if os.environ.get("INERTIAX_GOLDEN") == "write":
        remember(name, told)
    assert told == known()[name]


GOOD = good_calibration(thermal=False)


def test_the_golden_file_has_no_line_without_a_case():
    assert set(known()) == set(CASES)
    assert len(CASES) >= 60
