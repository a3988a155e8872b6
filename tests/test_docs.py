"""The code on the home page runs as it stands, in both precisions."""

import re
from pathlib import Path

import pytest

from hard_limit import run_here


HOME = Path(__file__).parents[1] / "docs" / "index.md"


@pytest.mark.slow
@pytest.mark.parametrize("wide", [False, True], ids=["32 bits", "64 bits"])
def test_home_page_example_runs(wide):
    blocks = re.findall(r"```python\n(.*?)```", HOME.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 1
    assert run_here(blocks[0], seconds=120.0, wide=wide).startswith("True")
