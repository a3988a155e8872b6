"""Every bad input to a command gives one line and no traceback: what, where, what would be right.

`INERTIAX_GOLDEN=write` writes the lines anew; read the difference before you commit it.
"""

import os
from pathlib import Path

import pytest

from bad_inputs_cases import CASES, CSV, good_calibration, TOML
from command_runs import place, run_in
from hard_limit import ends_within


GOLDEN = Path(__file__).with_name("bad_inputs.txt")
HANG = 300.0  # s; each takes a second or two, so that only one that does not end gets there on a slow machine


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
    with ends_within(HANG):
        status, out, err = run_in(case.arguments, tmp_path, capfd, monkeypatch)
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
