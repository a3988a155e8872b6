"""`inertiax protocol`: what was measured, how well, against which requirements; to read, to sign, for programs."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, inputs_kept, outputs
from .calibrate import command_line
from .options import AsJson, given_file, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..protocol.protocol import Protocol
    from ..protocol.requirements import Limit
    from ..protocol.station import Station


def protocol(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            exists=True,
            file_okay=False,
            help="Folder that `calibrate`, `diagnose` or `fleet` wrote.",
        ),
    ],
    output: OutputFolder,
    requirements: Annotated[
        Path | None,
        given_file('TOML whose table "requirements" has lines such as "accel.bias" = "0.3 mg".'),
    ] = None,
    station: Annotated[
        Path | None,
        given_file(
            "TOML with the tables station (name, operator, gravity_uncertainty, …) and device (manufacturer, "
            "model)."
        ),
    ] = None,
    operator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Who measured; goes before the station's.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="T,T,...",
            help="Temperatures, °C, of the results; default: both ends and the middle of the calibrated range.",
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(metavar="SERIAL", help="Which device, where RESULT holds several."),
    ] = None,
    every: Annotated[
        bool,
        typer.Option(
            "--all",
            help="Decide the requirements for every device of RESULT: decisions.csv, .json and .html.",
        ),
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Write the protocol of a calibration: protocol.html, protocol.pdf, protocol.json and dcc.xml.

    Results have expanded uncertainties with their budget by source; requirements are decided with a guard band. Exit
    status 0 whatever the decisions are.
    """
    outputs.require_folder(output)
    if every:
        _require_for_all(requirements, device, at, operator)
    if output.resolve() == result.resolve():
        raise typer.BadParameter(
            f"'{output}' is RESULT itself, whose figures a protocol would mix with; name another folder.",
            param_hint="'-o'",
        )
    temperatures = _temperatures(at)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare()
        from ..protocol.measurement import load_measurement
        from ..protocol.protocol import make_protocol
        from ..protocol.requirements import read_requirements
        from ..protocol.station import read_station, Station, with_operator
        from ..protocol.write import FILES, write_protocol

        written = (*FILES, "decisions.html", "decisions.json", "decisions.csv")
        inputs_kept.require_kept(output, written, (requirements, station))
        limits = () if requirements is None else read_requirements(requirements)
        said = Station() if station is None else read_station(station)
        if every:
            stages("deciding")
            _decide_on_all(result, output, said, limits, as_json=as_json, quiet=quiet)
            return
        said = said if operator is None else with_operator(said, operator)
        measured = load_measurement(result, device)
        made = make_protocol(measured, said, limits, temperatures)
        stages("writing the protocol")
        with outputs.staged_folder(output, replaces=FILES) as staging:
            missing = write_protocol(made, staging, command_line())
    if missing:
        few = "".join(sorted(missing)[:10]) + ("…" if len(missing) > 10 else "")
        console.warn(
            f"protocol.pdf shows □ for {len(missing)} characters that no font of this machine has ({few}); "
            "protocol.html is complete. An installed font that has them brings them in (Noto Sans CJK has Chinese, "
            "Japanese and Korean)"
        )
    _tell(made, output, as_json=as_json, quiet=quiet)


def _require_for_all(
    requirements: Path | None, device: str | None, at: str | None, operator: str | None
) -> None:
    if requirements is None:
        raise typer.BadParameter(
            "decides requirements; give --requirements FILE.", param_hint="'--all'"
        )
    for name, value in (("--device", device), ("--at", at), ("--operator", operator)):
        if value is not None:
            raise typer.BadParameter(f"does not go with {name}.", param_hint="'--all'")


def _decide_on_all(
    result: Path,
    output: Path,
    station: "Station",
    limits: "tuple[Limit, ...]",
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    from ..protocol.all_devices import counted, decide_on_all, document, FILES, write_decisions
    from ..protocol.measurement import each_measurement

    devices = decide_on_all(each_measurement(result), station, limits)
    with outputs.staged_folder(output, replaces=FILES) as staging:
        write_decisions(devices, limits, staging, command_line())
    if as_json:
        outputs.print_json(document(devices, limits))
    elif not quiet:
        console.say(counted(devices))
        console.say(f"decisions in {output}, see {output / 'decisions.html'}")


def _temperatures(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is not a list of temperatures such as -20,25,60.", param_hint="'--at'"
        ) from None


def _tell(made: "Protocol", output: Path, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        outputs.print_json(made.document())
    elif not quiet:
        from ..protocol.content import not_decided, verdict
        from ..protocol.identity import not_stated

        console.say(verdict(made).headline)
        for r in made.requirements:
            console.say(f"  {r.name} within {r.text}: {r.decision}")
        for sentence in not_decided(made):
            console.say(sentence)
        if (lacking := not_stated(made)) is not None:
            console.say(lacking)
        console.say(f"protocol in {output}, see {output / 'protocol.pdf'}")
