"""What MkDocs calls for every page: lines `<!-- generated: NAME -->` become what the program itself says.

Nothing that is generated is kept in the repository, so that it cannot differ from the program. Formulas become MathML,
and each tutorial is offered as a notebook, too.
"""

import re
from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Any

import command_line
import effect_catalogue
import export_formats
import first_layer
import mathematics
import notebooks
import result_files


GENERATORS: dict[str, Callable[[], str]] = {
    "command line": command_line.page,
    "effect catalogue": effect_catalogue.tables,
    "export formats": export_formats.formats,
    "first layer": first_layer.page,
    "result files": result_files.page,
}
MARK = re.compile(r"^<!-- generated: (.+) -->$", flags=re.MULTILINE)


TUTORIALS = PurePosixPath("tutorials")
# Who searches for a word wants the page on it before the function or the table that holds it.
LOOKED_UP = ("api/", "benchmarks/")


def on_files(files: Any, config: Any) -> Any:
    """The site's files with a notebook beside each tutorial."""
    from mkdocs.structure.files import File  # the other functions serve tests, too, without it

    for file in [f for f in files.documentation_pages() if _is_tutorial(f.src_uri)]:
        beside = str(PurePosixPath(file.src_uri).with_suffix(".ipynb"))
        made = notebooks.notebook(file.content_string)
        files.append(File.generated(config, beside, content=made))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page with its generated parts; a `KeyError` for a name that nothing generates."""
    markdown = MARK.sub(lambda mark: GENERATORS[mark[1]](), markdown)
    if page.file.src_uri.startswith(LOOKED_UP):
        page.meta.setdefault("search", {"boost": 0.5})
    if _is_tutorial(page.file.src_uri):
        title, _end, rest = markdown.partition("\n")
        name = PurePosixPath(page.file.src_uri).with_suffix(".ipynb").name
        markdown = (
            f"{title}\n\n[As a notebook]({name}), to be run in a clone of the repository.\n{rest}"
        )
    return markdown


def on_page_content(content: str, **_: Any) -> str:
    """The page's HTML with its formulas drawn."""
    return mathematics.rendered(content)


def _is_tutorial(source: str) -> bool:
    return PurePosixPath(source).parent == TUTORIALS
