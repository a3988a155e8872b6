"""`inertiax export`: a calibration in another tool's format, and what it loses there."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from ..storage.whole_files import write_atomically
from . import console, environment, inputs_kept, outputs
from .options import AsJson, given_file, Quiet, written


if TYPE_CHECKING:
    from ..exports import Export, Loss


_CONTROLLERS = ("px4", "ardupilot")  # correct outputs before they log them


def export(
    calibration: Annotated[
        Path | None,
        typer.Argument(
            metavar="CALIBRATION",
            exists=True,
            dir_okay=False,
            help="A calibration.json; kalibr writes noise alone without.",
        ),
    ] = None,
    to: Annotated[
        str | None, typer.Option("--to", metavar="FORMAT", help="Format to write; see --list.")
    ] = None,
    output: Annotated[
        Path | None,
        written("FILE", "Result; without it, CALIBRATION's name with the format's suffix."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="A setting of the format; repeat for several."
        ),
    ] = None,
    noise: Annotated[
        Path | None,
        given_file(
            "noise.json of `inertiax noise`, for formats that hold noise (--set goes before it)."
        ),
    ] = None,
    warm_up: Annotated[
        Path | None,
        given_file(
            "calibration.json of one pose over temperature; CALIBRATION, of one temperature, gets its biases.",
            "--warm-up",
        ),
    ] = None,
    made_at: Annotated[
        float | None,
        typer.Option(
            "--at",
            metavar="T",
            help="With --warm-up: temperature of CALIBRATION in °C, where it holds none.",
        ),
    ] = None,
    source: Annotated[
        str,
        typer.Option(
            "--from", metavar="FORMAT", help="Format of CALIBRATION, where it is another tool's."
        ),
    ] = "inertiax",
    reading: Annotated[
        list[str] | None,
        typer.Option(
            "--read",
            metavar="KEY=VALUE",
            help="A setting for reading with --from, such as kind=gyro.",
        ),
    ] = None,
    show_list: Annotated[
        bool, typer.Option("--list", help="Show the formats, what each keeps and loses.")
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Write a calibration in another tool's format; say what is lost and how large the error is.

    The error is computed: known inputs are distorted by the calibration's own model, compensated by the
    tool's formula with the numbers in the file, and compared, over the calibrated temperatures.
    """
    if show_list:
        _list(as_json=as_json)
        return
    values = _settings(settings or [], "'--set'")
    if calibration is None and to is not None and noise is not None:
        _noise_alone(to, noise, values, output, as_json=as_json, quiet=quiet)
        return
    if calibration is None or to is None:
        raise typer.BadParameter("CALIBRATION and --to FORMAT are needed (or --list).")
    how = _settings(reading or [], "'--read'")
    if how and source == "inertiax":
        raise typer.BadParameter("is for files of other tools, with --from.", param_hint="'--read'")
    if made_at is not None and warm_up is None:
        raise typer.BadParameter("is for calibrations with --warm-up.", param_hint="'--at'")
    if output is not None:
        outputs.require_file(output)
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare_without_jax()
        from ..exports import by_name, export as write, measure_loss
        from ..exports.registry import read_calibration_of

        for name, option in ((to, "'--to'"), (source, "'--from'")):
            _require_format(name, option)
        stages("reading")
        if source == "inertiax":
            from ..calibration.calibration import read_calibration

            known = read_calibration(calibration)
        else:
            known = read_calibration_of(calibration.read_bytes(), source, **how)
        joining: tuple[str, ...] = ()
        if warm_up is not None:
            from ..calibration.calibration import read_calibration
            from ..calibration.warm_up import with_warm_up

            joined = with_warm_up(known, read_calibration(warm_up), made_at)
            joining, known = joined.notes[len(known.notes) :], joined
        stages("exporting")
        from ..protocol.record import doubt_about, wrong_parameters

        files = [calibration] if warm_up is None else [calibration, warm_up]
        joining = (*filter(None, map(doubt_about, files)), *joining)
        if to in _CONTROLLERS:
            joining = (*(said for file in files for said in wrong_parameters(file)), *joining)
        notes: tuple[str, ...] = ()
        of_record, said = _of_record(to, calibration, values)
        if noise is not None:
            from ..exports.noise import settings_from_noise

            told = settings_from_noise(noise.read_bytes(), by_name(to), known.device, values)
            of_record, notes = {**of_record, **told.values}, told.notes
        values, notes = {**of_record, **values}, (*notes, *said)
        result = write(known, to, **values)
        result = result._replace(notes=(*joining, *notes, *result.notes))
        loss = measure_loss(known, result)
        place = output or _default(calibration, by_name(to).SUFFIX)
        files = _placed(result, place)
        for path, content in files.items():
            _require_replaceable(path, content, to, (calibration, warm_up, noise))
        with outputs.owned_results(place):
            for path, content in files.items():
                write_atomically(path, content)
    _tell(to, result, loss, list(files), as_json=as_json, quiet=quiet)


def _of_record(
    to: str, calibration: Path, given: dict[str, str]
) -> tuple[dict[str, str | int | float], tuple[str, ...]]:
    """Sampling rate and ROS topic of the recordings, by the record beside the calibration, and a note that says so."""
    from ..exports import by_name
    from ..exports.noise import known_settings
    from ..protocol.record import read_record

    if calibration.name != "calibration.json":
        return {}, ()
    try:
        known = read_record(calibration.parent).conditions
    except ValueError:
        return {}, ()  # none, or of another calibration
    found = known_settings(by_name(to), known.sample_rate, known.topic, known.sensor_ids)
    told = {k: v for k, v in found.items() if k not in given}
    words = ", ".join(
        f"{k} = {v:.6g}" if isinstance(v, float) else f"{k} = {v}" for k, v in told.items()
    )
    return told, (f"{words}: of the recordings that were calibrated",) if told else ()


def _noise_alone(
    to: str, noise: Path, given: dict[str, str], output: Path | None, *, as_json: bool, quiet: bool
) -> None:
    """A file of noise without a calibration, for formats that know one."""
    from ..exports import by_name
    from ..exports.noise import settings_from_noise
    from ..exports.registry import settings_of

    _require_format(to, "'--to'")
    module = by_name(to)
    if not hasattr(module, "write_noise"):
        raise typer.BadParameter(f"CALIBRATION is needed: {to} holds no noise without one.")
    place = output or noise.with_name(noise.name.split(".", 1)[0] + module.SUFFIX)
    outputs.require_file(place)
    told = settings_from_noise(noise.read_bytes(), module, "", given)
    content = module.write_noise(settings_of(module, {**told.values, **given}))
    _require_replaceable(place, content, to, (noise,))
    with outputs.owned_results(place):
        write_atomically(place, content)
    if as_json:
        made = {"schema": "inertiax.export/1", "format": to, "files": [str(place)], "losses": []}
        outputs.print_json({**made, "notes": list(told.notes), "error": None})
        return
    for note in told.notes:
        console.warn(f"note: {note}")
    if not quiet:
        console.say(f"{to}, noise alone: {place}")


def _settings(pairs: list[str], option: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise typer.BadParameter(f"'{pair}' must be KEY=VALUE.", param_hint=option)
        values[key.strip()] = value.strip()
    return values


def _require_format(name: str, option: str) -> None:
    from ..exports import by_name

    try:
        by_name(name)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint=option) from None


def _default(calibration: Path, suffix: str) -> Path:
    path = calibration.with_name(calibration.name.split(".", 1)[0] + suffix)
    if path == calibration:
        raise typer.BadParameter(
            f"'{path}' is the calibration itself; name the result.", param_hint="'-o'"
        )
    return path


def _placed(result: "Export", output: Path) -> dict[Path, bytes]:
    """The files of an export by where they go."""
    return {
        output.with_name(output.stem + tag + output.suffix) if tag else output: content
        for tag, content in result.files
    }


def _require_replaceable(
    path: Path, content: bytes, to: str, inputs: tuple[Path | None, ...]
) -> None:
    """A file that is there is replaced where it is an earlier export, no input and no recording.

    Raises `typer.BadParameter` (status 2) where it is not.
    """
    from ..exports.replaced_file import is_of_kind

    inputs_kept.require_other_than(path, inputs)
    inputs_kept.require_no_recording(path, inputs[0])
    if path.is_file() and not is_of_kind(path.read_bytes(), content):
        raise typer.BadParameter(
            f"'{path}' is there already, and is no file that --to {to} writes; name another place.",
            param_hint="'-o'",
        )


def _tell(
    name: str,
    result: "Export",
    loss: "Loss",
    written: list[Path],
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    if as_json:
        content = {
            "schema": "inertiax.export/1",
            "format": name,
            "files": [str(p) for p in written],
            "losses": list(result.losses),
            "notes": list(result.notes),
            "error": loss._asdict()
            | {"field": None if loss.field is None else loss.field._asdict()},
        }
        outputs.print_json(content)
        return
    for text in result.losses:
        console.warn(f"{name} loses {text}")
    if result.losses:
        console.warn(loss.sentence)
    for note in result.notes:
        console.warn(f"note: {note}")
    if not quiet:
        console.say(f"{name}: {', '.join(map(str, written))}")


def _list(*, as_json: bool) -> None:
    environment.prepare_without_jax()
    import msgspec

    from ..exports import FORMATS
    from ..exports.registry import loses

    rows = [
        {
            "format": f.NAME,
            "what": f.TITLE,
            "suffix": f.SUFFIX,
            "keeps": f.KEEPS,
            "loses": loses(f),
            "imports": hasattr(f, "read"),
            "settings": [field.name for field in msgspec.structs.fields(f.Settings)],
        }
        for f in FORMATS
    ]
    if as_json:
        outputs.print_json({"schema": "inertiax.export-formats/1", "formats": rows})
        return
    for row in rows:
        console.say(f"{row['format']}: {row['what']}" + (" (reads, too)" if row["imports"] else ""))
        console.say(f"  keeps     {row['keeps']}")
        console.say(f"  loses     {row['loses']}")
        if row["settings"]:
            console.say(f"  settings  {', '.join(row['settings'])}")
