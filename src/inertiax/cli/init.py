"""`inertiax init`: the `campaign.toml` that fits a log."""

import contextlib
import math
import re
from pathlib import Path
from typing import Annotated

import typer

from . import console, environment, inputs_kept, outputs
from .next_step import after_init
from .options import AsJson, Quiet, written


def init(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            exists=True,
            help="A recording: delimited text of any form, Parquet, or another format that is read. Several "
            "of the same columns are one campaign; the files of an app that writes one for each sensor, or their "
            "folder, are one recording.",
        ),
    ],
    output: Annotated[
        Path | None,
        written("DIR", "Folder for campaign.toml; the log's own without it."),
    ] = None,
    gyro: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            help="The gyros' log, where the triads are logged apart.",
        ),
    ] = None,
    table: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            help="The log that a table writes of its own, on whatever clock; one for all LOGs, or again for each, in "
            "their order.",
        ),
    ] = None,
    temperature: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            help="The log that a chamber or a probe writes of its own; one for all LOGs, or again for each, in their "
            "order.",
        ),
    ] = None,
    latitude: Annotated[
        float | None,
        typer.Option(min=-90.0, max=90.0, help="Of the test place, deg: gives gravity."),
    ] = None,
    height: Annotated[
        float, typer.Option(min=-500.0, max=9000.0, help="Of the test place, m; with --latitude.")
    ] = 0.0,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace a campaign.toml that is there.")
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Look at a log and write the campaign.toml that fits it.

    Columns are told by their names or numbers, units by physics: what gravity reads at rest, and whether it turns as
    the gyros say. What the log does not tell is marked CHECK in the file, with the reason.
    """
    log, *others = logs
    folder = output or log.absolute().parent
    file = outputs.require_folder(folder) / "campaign.toml"
    if file.exists() and not replace:
        raise typer.BadParameter(
            f"'{file}' is there already; --replace replaces it.", param_hint="'-o'"
        )
    inputs_kept.require_other_than(file, (*logs, gyro, *(table or ()), *(temperature or ())))
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..campaign_draft import draft_campaign
        from ..data.campaign import load_campaign
        from ..storage.whole_files import write_atomically

        stages(f"looking at {log.name}")
        draft = draft_campaign(
            log,
            folder,
            gyro=gyro,
            latitude=latitude,
            height=height,
            others=others,
            table=table,
            temperature=temperature,
        )
        before = file.read_bytes() if file.exists() else None
        made = [f for f in (folder, *folder.parents) if not f.exists()]
        with outputs.staged_folder(folder) as staging:
            (staging / file.name).write_text(draft.text, encoding="utf-8")
        stages("reading it back")
        campaign, problem = _read_back(load_campaign, file)
        if problem is not None and not _can_be_mended(draft, problem):
            _put_back(file, before, made)
            raise ValueError(f"{problem.rstrip('.')}. No campaign.toml was written.")
        if campaign is not None and "azimuth" in draft.untold:
            stages("asking the gyros for the azimuth")
            draft = _with_azimuth(draft, campaign)
            write_atomically(file, draft.text.encode())
    if as_json:
        outputs.print_json(
            {
                "schema": "inertiax.init/1",
                "campaign": str(file),
                "told": draft.told,
                "untold": draft.untold,
                "unread": draft.unread,
                "problem": problem,
            }
        )
    elif not quiet:
        for key, why in draft.untold.items():
            console.say(console.one_line(f"check {key}: {why}"))
        for remark in draft.unread:
            console.say(console.one_line(remark))
        console.say(console.one_line(f"written: {file}"))
        if problem is None:
            console.say(console.one_line(after_init(folder, checks=bool(draft.untold))))
    if problem is not None:
        console.warn(
            f"the campaign is written as a draft to mend, for it does not read yet: {problem}"
        )


def _read_back(load, file: Path) -> tuple:
    """The campaign, or why it cannot be read as it is: what the log lacks, which no mapping of columns gives."""
    try:
        return load(file), None
    except ValueError as error:
        return None, str(error)


def _can_be_mended(draft, problem: str) -> bool:
    """Whether lines of the draft can mend it: those of columns, or of what the problem names, as "[recordings]".

    A format that names its columns itself has none, and a file that is none of that format no cure in the draft.
    """
    named = re.search(r"\[(site|recordings|columns|table|rig|device|model)\]", problem)
    return named is not None or any(table.name == "columns" for table in draft.tables)


def _put_back(file: Path, before: bytes | None, made: list[Path]) -> None:
    """The file as it was, and no folder that was `made` for it, the innermost first."""
    from ..storage.whole_files import write_atomically

    if before is not None:
        write_atomically(file, before)
        return
    file.unlink()
    for folder in made:
        with contextlib.suppress(OSError):  # another run writes there by now
            folder.rmdir()


def _with_azimuth(draft, campaign):
    """The draft with the azimuth that the gyros read, where they tell it."""
    from ..campaign_draft.draft import with_line
    from ..campaign_draft.toml_text import Line
    from ..plausibility.azimuth import check_azimuth
    from ..plausibility.evidence import look_at
    from ..plausibility.thresholds import DEFAULT

    for found in check_azimuth(look_at(campaign, campaign.devices[0]), DEFAULT):
        numbers = {k: v for k, v in found.evidence if isinstance(v, float)}
        if "azimuth" in numbers:
            sigma = math.degrees(numbers["std"])
            why = f"where that north points, deg clockwise of true north: so the gyros read it, ± {sigma:.1f}"
            return with_line(draft, Line("azimuth", round(numbers["azimuth"], 1), why))
    return draft
