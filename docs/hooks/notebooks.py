"""Each tutorial as a notebook: prose, files, commands and Python in the order of the page."""

import json
import re
from typing import Any


FENCE = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$\n?', flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(!?)\[([^\]]*)\]\([^)]*\)")


def notebook(page: str) -> str:
    """The JSON of a notebook (format 4.5) for a tutorial's Markdown."""
    cells: list[dict[str, Any]] = []
    place = 0
    for block in FENCE.finditer(page):
        cells += _prose(page[place : block.start()])
        cells += _code(*block.groups(default=""))
        place = block.end()
    cells += _prose(page[place:])
    for k, cell in enumerate(cells):
        cell["id"] = f"cell-{k}"
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    document = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"


def _prose(text: str) -> list[dict[str, Any]]:
    """Markdown without pictures and links, which lead from the page's place and not from the notebook's."""
    plain = LINK.sub(lambda found: "" if found[1] else found[2], text).strip()
    return [{"cell_type": "markdown", "metadata": {}, "source": plain}] if plain else []


def _code(kind: str, title: str, text: str) -> list[dict[str, Any]]:
    if title:
        return [_cell(f"%%writefile {title}\n{text}")]
    if kind == "console":
        typed = [f"!{line[2:]}" for line in text.splitlines() if line.startswith("$ ")]
        return [_cell("\n".join(typed))]
    if kind == "python":
        return [_cell(text)]
    return _prose(f"```{kind}\n{text}```")


def _cell(source: str) -> dict[str, Any]:
    return {
        "cell_type": "code",
        "execution_count": None,
        "metadata": {},
        "outputs": [],
        "source": source.rstrip("\n"),
    }
