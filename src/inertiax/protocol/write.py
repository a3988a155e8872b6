"""All four documents of a protocol."""

from pathlib import Path

import msgspec

from ..storage.whole_files import write_atomically
from .dcc import write_dcc
from .figures import draw, FIGURES
from .page import write_html
from .pdf import write_pdf
from .protocol import Protocol


FILES = ("protocol.html", "protocol.pdf", "protocol.json", "dcc.xml", *FIGURES)


def write_protocol(protocol: Protocol, folder: Path, command: str) -> frozenset[str]:
    """Write `protocol.html`, `protocol.pdf`, `protocol.json`, `dcc.xml` and their figures.

    **Returns** the characters that `protocol.pdf` lacks, because no font of this machine has them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = draw(protocol, folder)
    write_html(protocol, folder, command, figures)
    missing = write_pdf(protocol, folder, command, figures)
    write_dcc(protocol, folder)
    content = msgspec.json.format(msgspec.json.encode(protocol.document()), indent=1)
    write_atomically(folder / "protocol.json", content + b"\n")
    return missing
