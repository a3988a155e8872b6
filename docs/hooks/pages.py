"""What MkDocs calls for every page: lines `<!-- generated: NAME -->` become what the program itself says.

Nothing that is generated is kept in the repository, so that it cannot differ from the program. Formulas become MathML.
"""

import re
from collections.abc import Callable
from typing import Any

import command_line
import effect_catalogue
import export_formats
import first_layer
import mathematics
import result_files


GENERATORS: dict[str, Callable[[], str]] = {
    "command line": command_line.page,
    "effect catalogue": effect_catalogue.tables,
    "export formats": export_formats.formats,
    "first layer": first_layer.page,
    "result files": result_files.page,
}
MARK = re.compile(r"^<!-- generated: (.+) -->$", flags=re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its generated parts; a `KeyError` for a name that nothing generates."""
    return MARK.sub(lambda mark: GENERATORS[mark[1]](), markdown)


def on_page_content(content: str, **_: Any) -> str:
    """The page's HTML with its formulas drawn."""
    return mathematics.rendered(content)
