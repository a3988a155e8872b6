"""The `inertiax` command: its subcommands, and what every failure looks like.

Exit status: 0 done; 1 a run that failed for a reason in the data, said in one line on standard error;
2 wrong usage.
"""

import importlib.metadata
import os
import sys
from typing import Annotated

import typer

from . import calibrate, compensate, demo, design, diagnose, export, fleet, noise, simulate


app = typer.Typer(
    help="Calibrate inertial sensors over temperature, and explain what a model leaves out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# A new command is a function in a file of this folder and a line here.
app.command("demo")(demo.demo)
app.command("calibrate")(calibrate.calibrate)
app.command("compensate")(compensate.compensate)
app.command("diagnose")(diagnose.diagnose)
app.command("design")(design.design)
app.command("export")(export.export)
app.command("fleet")(fleet.fleet)
app.command("noise")(noise.noise)
app.command("simulate")(simulate.simulate)


def _version(asked: bool | None) -> None:
    if asked:
        typer.echo(f"inertiax {importlib.metadata.version('inertiax')}")
        raise typer.Exit()


@app.callback()
def _options(
    version: Annotated[
        bool | None,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = None,
) -> None:
    del version


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; always raises `SystemExit`.

    A `ValueError` is the library's way to say what is wrong with the data: it becomes one line and
    status 1. Anything unforeseen is said in one line too; `INERTIAX_TRACEBACK=1` shows where.
    """
    try:
        app(arguments)
    except Exception as error:
        if os.environ.get("INERTIAX_TRACEBACK"):
            raise
        print(f"inertiax: {_one_line(error)}", file=sys.stderr)
        sys.exit(1)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    if type(error) is ValueError or isinstance(error, OSError):
        return text
    return f"unforeseen {type(error).__name__}: {text[:300]} (INERTIAX_TRACEBACK=1 shows where)"
