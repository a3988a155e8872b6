"""`protocol.html`: the protocol as one self-contained page."""

from collections.abc import Sequence
from pathlib import Path

from ..report.page import Section, write_page
from . import content
from .figures import Drawn
from .identity import identity
from .protocol import Protocol


def write_html(protocol: Protocol, folder: Path, command: str, figures: Sequence[Drawn]) -> None:
    """Write the page."""
    needed, beside = content.requirements(protocol), content.effects(protocol)
    write_page(
        folder / "protocol.html",
        title=content.title(protocol),
        under=content.under(protocol),
        verdict=content.verdict(protocol),
        keys=content.keys(protocol),
        sections=[
            identity(protocol),
            *([] if needed is None else [needed]),
            *content.results(protocol),
            *([] if beside is None else [beside]),
            *content.budgets(protocol),
            content.procedure(protocol),
            *content.limits_of_knowledge(protocol),
            *([Section("Figures", figures=tuple(f.picture for f in figures))] if figures else []),
            content.inputs(protocol),
            content.signatures(protocol),
        ],
        command=command,
    )
