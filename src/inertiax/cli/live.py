"""`inertiax live`: follows a recording while it is made, says where to turn next, and when to stop."""

import datetime
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Annotated, TYPE_CHECKING

import typer

from . import (
    calibrate as calibrate_command,
    console,
    environment,
    inputs_kept,
    live_plan,
    outputs,
)
from .live_lines import Words
from .options import CampaignPath, Force, Quiet, written


if TYPE_CHECKING:
    from ..diagnose.plan.separate import Separation
    from ..live.follow import Plan
    from ..live.page_server import PageServer

PAGE = "page.html"  # what the page showed last


def live(
    campaign: CampaignPath,
    source: Annotated[
        str | None, typer.Argument(metavar="[-]", help="- reads rows from standard input.")
    ] = None,
    follow: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="A text log that grows, or a serial line or pipe that gives rows; by default the one file that the "
            "campaign names.",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="LIMITS",
            help='What the errors are to stay below, such as "accel.bias=0.3 mg, accel.scale=200 ppm" (all of them '
            "together with 95 %); by default what is usual for [device] grade, of the accelerometers alone.",
        ),
    ] = None,
    ahead: Annotated[
        bool,
        typer.Option(
            "--plan",
            help="Follow nothing, but say how many rests the target needs, by the noise of a rest's mean.",
        ),
    ] = False,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="NOISE",
            help='With --plan: the noise of a rest\'s mean with its scatter from rest to rest, such as "0.35 mg"; by '
            "default several.",
        ),
    ] = None,
    separate: Annotated[
        Path | None,
        typer.Option(
            metavar="DIAGNOSIS",
            help="diagnosis.json, or the folder that holds it: follow the run that tells apart the names which it "
            "could not, and diagnose both.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        written(
            "DIR",
            "New folder for what is recorded and for the results; by default live-DATE-TIME beside the campaign.",
        ),
    ] = None,
    hold: Annotated[
        float,
        typer.Option(
            min=1.0, max=600.0, help="s that a rest lasts when the next position is told."
        ),
    ] = 4.0,
    idle: Annotated[
        float,
        typer.Option(min=0.1, help="s without a row after which the input counts as ended."),
    ] = 15.0,
    page: Annotated[
        bool,
        typer.Option(
            "--page",
            help="Show it on a web page, too, which only this machine can open; needs pip install 'inertiax[page]'.",
        ),
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Of the page; 0, the default, is a free one."),
    ] = None,
    force: Force = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="One JSON object a line on standard output for each event."),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Follow a recording while it is made: what is covered, where to turn next, when to stop.

    Rows are recorded as they come. When the target is reached, nothing gains or the input ends (Ctrl-C ends it), the
    recording is calibrated as `inertiax calibrate DIR` would.

    With `--plan` it says beforehand how many rests the target needs, and follows nothing. With `--separate` the steps
    of a run are told instead, and at the end it is diagnosed with the campaign before.
    """
    _check_source(source, follow)
    if separate is not None and target is not None:
        raise typer.BadParameter("means nothing with --separate.", param_hint="'--target'")
    if noise is not None and not ahead:
        raise typer.BadParameter("is the plan's: give --plan, too.", param_hint="'--noise'")
    if ahead:
        outputs.require_campaign(campaign)
        live_plan.tell(campaign, target, noise, hold, as_json=as_json)
        return
    if port is not None and not page:
        raise typer.BadParameter("is the page's: give --page, too.", param_hint="'--port'")
    outputs.require_campaign(campaign)
    folder = _folder(campaign, output)
    if separate is not None:
        said = separate / "diagnosis.json" if separate.is_dir() else separate
        inputs_kept.require_kept(folder, ("diagnosis.json", "report.html"), (said,))
    # JAX is set up for the calibration at the end; until then nothing is compiled.
    environment.prepare()
    from ..live.follow import events, plan
    from ..live.recorder import Recorder

    made = plan(campaign, follow, piped=source is not None, target=target)
    run = None
    if separate is not None:
        run = _proposed(separate, quiet=quiet)
        made, hold = _followed(made, run)
    with outputs.owned_results(folder), _opened(page, port, folder) as shown:
        assert made.campaign.path is not None
        recorder = Recorder(folder, made.campaign.path)
        tellers = [_Json() if as_json else Words(quiet=quiet), _Bell()]
        tellers += [] if shown is None else [shown]
        with _ends_on_interrupt() as stopped:
            told = events(made, recorder, idle=idle, hold=hold, stopped=stopped, watch=shown)
            for event in told:
                for tell in tellers:
                    tell(event)
        recorder.close()
    if run is None:
        _results(folder, force=force, quiet=quiet or as_json)
    else:
        _diagnosed(run, folder, quiet=quiet or as_json)


def _check_source(source: str | None, follow: Path | None) -> None:
    if source is not None and source != "-":
        raise typer.BadParameter(
            f"'{source}' is not -; a log to follow is given with --follow LOG.", param_hint="'[-]'"
        )
    if source is not None and follow is not None:
        raise typer.BadParameter(
            "give either - or --follow LOG, not both.", param_hint="'--follow'"
        )


def _folder(campaign: Path, asked: Path | None) -> Path:
    """A folder without a campaign: what was recorded before is never mixed with what comes."""
    home = campaign if campaign.is_dir() else campaign.absolute().parent
    new = home / f"live-{datetime.datetime.now():%Y%m%d-%H%M%S}"
    folder = outputs.require_folder(new if asked is None else asked)
    for name, what in (("campaign.toml", "a campaign"), ("recording-*.csv", "recordings")):
        if any(folder.glob(name)):
            raise typer.BadParameter(
                f"'{folder}' holds {what} already; name a new folder.", param_hint="'-o'"
            )
    return folder


def _results(folder: Path, *, force: bool, quiet: bool) -> None:
    """What `inertiax calibrate` writes of what was recorded."""
    if not any(folder.glob("recording-*.csv")):
        raise ValueError(f"{folder}: no rows came, so nothing was recorded.")
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(folder):
        from ..calibrate.pipeline import calibrate, DeviceFailure
        from ..data.campaign import load_campaign
        from ..data.inputs import campaign_inputs
        from ..live.recorder import FILES

        stages("reading what was recorded")
        loaded = load_campaign(folder)
        results = calibrate(loaded, force=force, progress=stages)
        inputs = partial(campaign_inputs, loaded.path)
        folders = calibrate_command.write_results(results, loaded, folder, stages, inputs)
    failed = [r for r in results if isinstance(r, DeviceFailure)]
    if failed:
        console.warn(f"{folder}: recorded, but not calibrated: {failed[0].reason}")
        raise typer.Exit(1)
    if not quiet:
        files = ", ".join(str(p) for p in sorted(folder.glob(FILES)))
        # A session's ± hold what few rests leave unknown of the noise, those of the table do not.
        console.say(f"recorded: {files} (its ± below are narrower: they take the noise as known)")
        calibrate_command.tell_results(results, folders, folder)


def _proposed(diagnosis: Path, *, quiet: bool) -> "Separation":
    """The run that parts a diagnosis' set, its odds told on standard error."""
    from ..diagnose.wording.separation import summary
    from ..live.separation import proposed

    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        found = proposed(diagnosis, stages)
    if not quiet:
        console.say("\n".join(summary(found)), aside=True)
    return found


def _followed(made: "Plan", run: "Separation") -> "tuple[Plan, float]":
    """The plan with the run's steps instead of a target, and how long each of them rests, s."""
    from ..live.separation import itinerary
    from ..live.target import Target

    steps = itinerary(run.best.run)
    *others, last = run.names.names
    text = f"{run.best.run.name}, to tell {', '.join(others)} and {last} apart"
    return replace(made, target=Target(text, ()), itinerary=steps), steps.steps[0].seconds


def _diagnosed(run: "Separation", folder: Path, *, quiet: bool) -> None:
    """The campaign and what was recorded, diagnosed together: `diagnosis.json` and `report.html`."""
    if not any(folder.glob("recording-*.csv")):
        raise ValueError(f"{folder}: no rows came, so nothing was recorded.")
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(folder):
        from ..live.separation import diagnosed_together
        from ..report.diagnosis import report_diagnosis

        found, both = diagnosed_together(run.campaign, folder, stages)
        found.save(folder / "diagnosis.json")
        report_diagnosis(found, folder, calibrate_command.command_line(), campaign=both)
    if not quiet:
        names = "; ".join(" or ".join((e.name, *e.alternatives)) for e in found.effects)
        console.say(f"diagnosed together: {names or found.verdict}; {folder}")


@contextmanager
def _opened(page: bool, port: int | None, folder: Path) -> Iterator["PageServer | None"]:
    """The page's server, its address told on standard error; `None` where no page is asked for.

    At the end the page is kept as a file beside what was recorded, if anything was.
    """
    if not page:
        yield None
        return
    from ..live.page_server import PageServer

    server = PageServer(port or 0)
    try:
        with server:
            console.say(f"page: {server.address}", aside=True)
            yield server
    finally:
        if folder.is_dir():
            server.save(folder / PAGE)
            console.say(f"page: kept as {folder / PAGE}", aside=True)


@contextmanager
def _ends_on_interrupt() -> Iterator:
    """Ctrl-C ends the input, not the run; a second one ends the run."""
    asked: list[int] = []
    before = signal.getsignal(signal.SIGINT)

    def arrived(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, before)

    try:
        signal.signal(signal.SIGINT, arrived)
    except ValueError:  # not the main thread
        yield lambda: False
        return
    try:
        yield lambda: bool(asked)
    finally:
        signal.signal(signal.SIGINT, before)


class _Json:
    """Events as they come, one JSON object a line."""

    def __init__(self) -> None:
        import msgspec

        self._encode = msgspec.json.encode

    def __call__(self, event: dict) -> None:
        outputs.print_document(self._encode(event).decode())
        sys.stdout.flush()


class _Bell:
    """The bell of the terminal that standard error is: for who looks at the device.

    Once where the device may be turned, for a rest that is accepted, and at the end; twice for one that is refused.
    """

    def __init__(self) -> None:
        self._heard = sys.stderr.isatty()
        self._wanted = ""

    def __call__(self, event: dict) -> None:
        if self._heard:
            os.write(sys.stderr.fileno(), b"\a" * self._times(event))

    def _times(self, event: dict) -> int:
        kind = event["event"]
        if kind == "next":
            same, self._wanted = event["statement"] == self._wanted, event["statement"]
            return 0 if same else 1
        if kind == "rest":
            return 1 if event["accepted"] else 2
        return 1 if kind == "done" else 0
