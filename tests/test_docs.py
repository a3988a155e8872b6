"""The code on the home page, which sets the precision itself, runs as it stands."""

import re
from pathlib import Path

import pytest

from hard_limit import run_here


HOME = Path(__file__).parents[1] / "docs" / "index.md"


@pytest.mark.slow
def test_home_page_example_runs():
    blocks = re.findall(r"```python\n(.*?)```", HOME.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 1
    assert run_here(blocks[0], seconds=120.0, wide=False).startswith("True")
