"""The command line: one file per command, collected in `app`. Importing it loads no JAX."""

from .interrupts import handled
from .streams import any_text


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; always raises `SystemExit`. Signals are handled before anything large is loaded."""
    with handled(), any_text():
        from .app import run

        run(arguments)
