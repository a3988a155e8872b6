"""The page on other libraries of JAX runs with the real ones, each block pasted alone.

A block sets the precision that it needs itself, so it runs with JAX's defaults, as a reader's does.
"""

import importlib.util
import re
import warnings
from pathlib import Path

import pytest

from hard_limit import run_here


PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "other-libraries.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
LIBRARIES = ("blackjax", "cuthbert", "jaxls")


def test_each_library_has_a_block():
    assert [next(n for n in LIBRARIES if n in block) for block in BLOCKS] == list(LIBRARIES)
    assert all('jax.config.update("jax_enable_x64", True)' in block for block in BLOCKS)


@pytest.mark.slow
@pytest.mark.parametrize(("library", "block"), list(zip(LIBRARIES, BLOCKS)), ids=LIBRARIES)
def test_block_runs_alone(library, block):
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed: it is in the extra 'adapters'")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the libraries' own
        run_here(block, seconds=300.0, wide=False)
