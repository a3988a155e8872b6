"""Every code block of the library's page runs pasted alone, in JAX's defaults: 32 bits.

`test_first_layer_precision.py` has what the blocks call in both precisions.
"""

import re
from pathlib import Path

import pytest

from hard_limit import run_here


PAGE = Path(__file__).parents[1] / "docs" / "api" / "library.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.slow
def test_blocks_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(BLOCKS) == 9
    for block in BLOCKS:
        run_here(block, seconds=600.0, wide=False)
