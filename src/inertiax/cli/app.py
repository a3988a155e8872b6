"""The `inertiax` command: its subcommands, and what every failure looks like.

Exit status: 0 done; 1 a run that failed for a reason in the data, said in one line on standard error;
2 wrong usage.
"""

import importlib.metadata
import os
import sys
from typing import Annotated, cast

import typer

from ..storage.harmless_text import one_line
from ..storage.wrong_value import WrongValue
from . import (
    calibrate,
    check,
    compensate,
    console,
    demo,
    design,
    diagnose,
    export,
    fleet,
    init,
    learn_noise,
    live,
    noise,
    protocol,
    simulate,
)


app = typer.Typer(
    help="Calibrate inertial sensors over temperature, and explain what a model leaves out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: quicker, and brackets such as [columns] stay text
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

# A new command is a function in a file of this folder and a line here, with what the list of commands says of it.
_COMMANDS = {
    demo.demo: "Simulate and calibrate the founding paper's experiment.",
    calibrate.calibrate: "Estimate the error parameters of every device.",
    check.check: "Look for what cannot be right, before any fit.",
    compensate.compensate: "Apply a calibration to a recording.",
    diagnose.diagnose: "Locate, name and model what the model left out.",
    design.design: "Judge a plan before it is run, or find a better one.",
    export.export: "Write a calibration in another tool's format.",
    fleet.fleet: "Calibrate many devices; bad ones are set aside.",
    init.init: "Write the campaign.toml that fits a log.",
    learn_noise.learn_noise: "Learn a type's noise from units that lack nothing.",
    live.live: "Follow a recording: where to turn next, when to stop.",
    noise.noise: "Allan deviations and noise coefficients of a log.",
    protocol.protocol: "Write the protocol of a calibration, to sign.",
    simulate.simulate: "Write a campaign that a simulated station records.",
}
for _command, _help in _COMMANDS.items():
    app.command(_command.__name__.replace("_", "-"), short_help=_help)(_command)


def _version(asked: bool | None) -> None:
    if asked:
        console.say(f"inertiax {importlib.metadata.version('inertiax')}")
        raise typer.Exit()


@app.callback()
def _options(
    version: Annotated[
        bool | None,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = None,
) -> None:
    del version


def run(arguments: list[str] | None = None) -> None:
    """Run the command line; always raises `SystemExit`.

    A `ValueError` is the library's way to say what is wrong with the data: it becomes one line and
    status 1. Wrong usage is one line, too, and status 2, also a `WrongValue` that the library
    refuses. Anything unforeseen is said in one line; `INERTIAX_TRACEBACK=1` shows where.
    """
    try:
        _require_unicode(sys.argv[1:] if arguments is None else arguments)
        status = app(arguments, prog_name="inertiax", standalone_mode=False)
    except _Usage as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # `inertiax` alone: its message is the help
            error.show()
        else:
            command = getattr(getattr(error, "ctx", None), "command_path", "inertiax")
            said = one_line(error.format_message()).rstrip(".")
            said += "" if said.endswith("?") else "."
            print(f"inertiax: {said} See `{command} --help`.", file=sys.stderr)
        status = error.exit_code
    except WrongValue as error:
        print(f"inertiax: {one_line(str(error))}", file=sys.stderr)
        status = 2
    except (KeyboardInterrupt, typer.Abort):  # where no handler could be set: see `interrupts`
        print("inertiax: interrupted.", file=sys.stderr)
        status = 130  # as a shell says it
    except Exception as error:
        if os.environ.get("INERTIAX_TRACEBACK"):
            raise
        print(f"inertiax: {_in_words(error)}", file=sys.stderr)
        status = 1
    sys.exit(status)


# click's `ClickException`, which typer carries inside itself or imports, by its version.
_Usage = cast(
    "type[typer.BadParameter]",
    next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException"),
)


def _require_unicode(arguments: list[str]) -> None:
    """Names of files are shown, and stand in results, which are UTF-8."""
    for argument in arguments:
        if any("\ud800" <= c <= "\udfff" for c in argument):
            raise typer.BadParameter(f"'{argument}' is no UTF-8; rename it.")


def _in_words(error: Exception) -> str:
    if type(error) is ValueError:
        return one_line(str(error))
    if isinstance(error, UnicodeEncodeError):
        said = one_line(error.object[max(error.start - 40, 0) : error.end])
        return f"'…{said}' is no UTF-8 and cannot be written; rename it."
    if isinstance(error, OSError):
        folder, slash, last = str(error.filename or "writing or reading").rpartition("/")
        last = last if len(last) < 100 else f"{last[:40]}…"
        name = one_line(f"{folder}{slash}{last}")
        return f"{name}: {one_line(str(error.strerror or error))}."
    if isinstance(error, MemoryError):
        return "not enough memory for this much data; split it, or use a machine with more."
    said = one_line(str(error))[:300]
    if "(os error " in said:  # libraries in Rust tell of a full disk in their own exceptions
        return f"writing or reading: {said.rsplit(': ', 1)[-1].split(' (os error')[0]}."
    return f"unforeseen {type(error).__name__}: {said} (INERTIAX_TRACEBACK=1 shows where)"
