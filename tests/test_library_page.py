"""Every code block of the library's page runs pasted alone, in both precisions."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


PAGE = Path(__file__).parents[1] / "docs" / "api" / "library.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)

# One process for all blocks, each with names of its own, as pasting alone would give it.
RUN = """
import re, sys
for k, block in enumerate(re.findall(r"```python\\n(.*?)```", open(sys.argv[1], encoding="utf-8").read(), re.DOTALL)):
    exec(compile(block, f"block {k}", "exec"), {"__name__": "__main__"})
    print("done", k)
"""


@pytest.mark.slow
@pytest.mark.parametrize("wide", ["0", "1"])
def test_blocks_run(wide):
    assert len(BLOCKS) == 5
    environment = {**os.environ, "JAX_ENABLE_X64": wide}
    ran = subprocess.run(
        [sys.executable, "-c", RUN, str(PAGE)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert f"done {len(BLOCKS) - 1}" in ran.stdout, ran.stderr[-2000:]
