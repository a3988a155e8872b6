"""Markdown tables."""

import re
from collections.abc import Iterable


def table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A table; bars inside code stay as they are, others are escaped."""
    return "\n".join([_row(heads), "|---" * len(heads) + "|", *(_row(r) for r in rows)])


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(_escaped(c) for c in cells) + " |"


def _escaped(cell: str) -> str:
    parts = re.split(r"(`[^`]*`)", cell)
    return "".join(p if p.startswith("`") else p.replace("|", "\\|") for p in parts)
