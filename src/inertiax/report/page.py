"""One self-contained HTML page: a verdict, key figures, tables, figures, the command to reproduce it.

Nothing is loaded from elsewhere. All text is escaped, since names of devices and files come from
outside; only figures, which this package drew itself, are put in as they are.
"""

import platform
import re
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import escape, Markup

from .._records import Module
from ..plots.figure_workers import Drawing
from ..plots.style import both_forms, COLOURS, Figure, Forms
from ..storage.whole_files import write_atomically


SHORT = 28  # characters that a cell keeps in one line


class Verdict(Module):
    """What the reader should take away. `tone` is good, attention or bad."""

    tone: str
    headline: str
    lines: tuple[str, ...] = ()


class Key(Module):
    """One key figure."""

    name: str
    value: str
    detail: str = ""


class Link(Module):
    """A table cell that leads to a file beside the page."""

    text: str
    href: str


class Table(Module):
    """Rows of text; columns listed in `numeric` are set to the right."""

    head: tuple[str, ...]
    rows: tuple[tuple[str | Link, ...], ...]
    numeric: tuple[int, ...] = ()
    caption: str = ""


class _Laid(Module):
    """A table as the template takes it: with every cell the class of its column."""

    head: tuple[tuple[str, str], ...]
    rows: tuple[tuple[tuple[str | Link, str], ...], ...]
    caption: str


class Picture(Module):
    """A figure in a page; `alt` says in words what it shows."""

    drawn: Callable[[], Markup]
    caption: str
    alt: str

    @property
    def svg(self) -> Markup:
        """The figure as it stands in the page; waits until it is drawn."""
        return self.drawn()


class Section(Module):
    """A part of the page."""

    title: str
    lines: tuple[str, ...] = ()
    items: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Picture, ...] = ()


def write_page(
    path: Path,
    *,
    title: str,
    under: str,
    verdict: Verdict,
    sections: Sequence[Section],
    command: str,
    keys: Sequence[Key] = (),
) -> None:
    """Render the page and write it."""
    loader = PackageLoader("inertiax", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"whole": _whole, "laid_out": _laid_out}
    text = environment.get_template("base.html").render(
        title=title,
        under=under,
        verdict=verdict,
        keys=keys,
        sections=sections,
        command=command,
        versions=versions(),
        footer=f"Written by inertiax {version('inertiax')}.",
    )
    write_atomically(path, text.encode())


# Numbers with an exponent or a unit, and options: what a line break would tear apart.
_WHOLE = re.compile(
    r"[-+±]?\d[\d.]*(?:e[-+]\d+(?: [°%µ][^\s.,;)]*)?| (?:[°%µ][^\s.,;)]*|ppm\b|m/s²|rad/s))|--[a-z][a-z-]*"
)


def _whole(text: str) -> Markup:
    """The text, escaped, with numbers kept in one line together with their units."""
    pieces, end = [], 0
    for found in _WHOLE.finditer(text):
        pieces += [escape(text[end : found.start()]), Markup('<span class="w">')]
        pieces += [escape(found[0]), Markup("</span>")]
        end = found.end()
    return Markup("").join([*pieces, escape(text[end:])])


def _laid_out(table: Table) -> _Laid:
    """Columns without any text are left out; class n is set to the right, l wraps."""
    text = lambda cell: cell.text if isinstance(cell, Link) else cell
    columns = list(zip(*table.rows, strict=True)) or [()] * len(table.head)
    kinds = {}
    for k, column in enumerate(columns):
        longest = max((len(text(cell)) for cell in column), default=0)
        if longest or not table.rows:
            kinds[k] = "n" if k in table.numeric else "l" if longest > SHORT else ""
    head = tuple((table.head[k], kind) for k, kind in kinds.items())
    rows = tuple(tuple((row[k], kind) for k, kind in kinds.items()) for row in table.rows)
    return _Laid(head, rows, table.caption)


def versions() -> str:
    """The versions that a result depends on."""
    packages = ("inertiax", "jax", "jaxlib", "equinox", "optimistix", "numpy")
    names = ", ".join(f"{p} {version(p)}" for p in packages)
    return (
        f"{names}; Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    )


def picture(
    figure: Drawing[Forms] | Figure, folder: Path, name: str, caption: str, alt: str
) -> Picture:
    """Put a figure into the page and write it as `figures/NAME.png` and `.svg`.

    One that is still to be drawn may be drawn by another process meanwhile (`figure_workers.drawn_aside`); it is
    written where the page is.
    """
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    if isinstance(figure, Drawing):
        result = figure.begin()
        return Picture(cache(lambda: _written(result(), figures, name)), caption, alt)
    made = _written(both_forms(figure), figures, name)
    return Picture(lambda: made, caption, alt)


def _written(made: Forms, figures: Path, name: str) -> Markup:
    """Write both files; the figure for the page."""
    write_atomically(figures / f"{name}.png", made.png, durable=False)
    # Alone, a figure has no page to take its colour from.
    alone = made.svg.replace("<svg ", '<svg style="background:#fff;color:#262626" ', 1)
    write_atomically(figures / f"{name}.svg", alone.encode(), durable=False)
    inside = _own_ids(made.svg, name)
    inside = inside.replace("<svg ", f'<svg style="--full:{8 * made.width:.0f}rem" ', 1)
    for number, colour in enumerate(COLOURS):
        inside = inside.replace(colour.lower(), f"var(--c{number})")  # lighter on a dark ground
    return Markup(inside)


def _own_ids(svg: str, name: str) -> str:
    """Prefix a figure's ids, which must be unique in a page of several figures."""
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    return re.sub(r"url\(#", f"url(#{name}-", svg)
