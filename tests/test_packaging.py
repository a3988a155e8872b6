"""What is shipped says the same as what is installed, and a typed user's script passes pyright's strict mode."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import inertiax


ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_every_statement_of_the_version_is_the_same():
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    assert cited is not None and cited[1] == PROJECT["version"] == inertiax.__version__


def test_the_package_says_that_it_is_typed():
    assert (Path(inertiax.__file__).parent / "py.typed").is_file()


def test_public_names_are_what_they_say():
    for name in dir(inertiax):
        assert getattr(inertiax, name) is getattr(inertiax, name)


def pyright() -> str | None:
    beside = Path(sys.executable).with_name("pyright")
    return str(beside) if beside.is_file() else shutil.which("pyright")


@pytest.mark.slow
@pytest.mark.skipif(pyright() is None, reason="pyright is not installed (inertiax[dev])")
def test_a_users_script_passes_strict_typing(tmp_path):
    script = (ROOT / "tests" / "typing_user.py").read_text("utf-8")
    (tmp_path / "right.py").write_text(script)
    wrong = script.replace("    return solution.curve\n", "    return solution.curve.basis\n")
    assert wrong != script
    (tmp_path / "wrong.py").write_text(wrong)
    # Where the checkout is not installed, its `src` is found all the same.
    settings = {"typeCheckingMode": "strict", "extraPaths": [str(ROOT / "src")]}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    done = subprocess.run(
        [str(pyright()), "--outputjson", "--pythonpath", sys.executable],
        cwd=tmp_path, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    found = json.loads(done.stdout)["generalDiagnostics"]
    said = [(Path(d["file"]).name, d["range"]["start"]["line"] + 1, d["message"]) for d in found]
    assert [s for s in said if s[0] == "right.py"] == []
    assert len([s for s in said if s[0] == "wrong.py"]) == 1, said
