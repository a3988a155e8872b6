"""The page on other libraries of JAX runs with the real ones, each block pasted alone, in both precisions."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "other-libraries.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
LIBRARIES = ("blackjax", "cuthbert", "jaxls")


def test_each_library_has_a_block():
    assert [next(n for n in LIBRARIES if n in block) for block in BLOCKS] == list(LIBRARIES)


@pytest.mark.slow
@pytest.mark.parametrize("wide", [False, True], ids=["32 bits", "64 bits"])
@pytest.mark.parametrize(("library", "block"), list(zip(LIBRARIES, BLOCKS)), ids=LIBRARIES)
def test_block_runs_alone(library, block, wide):
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed: it is in the extra 'adapters'")
    ran = subprocess.run(
        [sys.executable, "-c", block],
        env={**os.environ, "JAX_ENABLE_X64": str(int(wide))},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
