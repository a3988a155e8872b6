"""`inertiax design`: what a given plan can tell, and which plan to take."""

import tomllib
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Annotated, TYPE_CHECKING, TypeVar

import typer

from . import console, environment, inputs_kept, outputs
from .options import AsJson, Quiet, written


if TYPE_CHECKING:
    from ..data.recording import Campaign
    from ..design.shown_conditions import Conditions


_JUDGE, _FIND = "Judge a plan (--audit)", "Find a plan (--optimise)"
_PART = "Part what a diagnosis left together (--separate)"
_USUAL = {
    "experiments": 13, "degree": 6, "low": -55.0, "high": 60.0, "density": 8e-5, "repeatability": 0.0,
}  # fmt: skip
_CRITERIA = ("D", "A", "I")  # as in ..design, which needs JAX to import

Reach = tuple[float, float]
Given = TypeVar("Given")


@dataclass(frozen=True)
class Wanted:
    """What --optimise is to find, in the units of the command line."""

    positions: int
    criterion: str
    outer: Reach
    inner: Reach
    step: float
    experiments: int
    degree: int
    low: float
    high: float
    target: float | None
    density: float
    repeatability: float

    def check(self) -> None:
        """What the optimiser would refuse later, said in the command's own words; status 2."""
        wrong = lambda text, option: typer.BadParameter(text, param_hint=f"'{option}'")
        if self.positions < 9:
            raise wrong(f"{self.positions} positions cannot determine 9 parameters.", "--positions")
        if self.criterion not in _CRITERIA:
            raise wrong(f"'{self.criterion}' is none of {', '.join(_CRITERIA)}.", "--criterion")
        reaches = {"--outer": self.outer, "--inner": self.inner, "--low": (self.low, self.high)}
        for option, (low, high) in reaches.items():
            if not low < high:
                raise wrong(f"{low:g} is not below {high:g}.", option)
        if self.degree < 0 or self.experiments <= self.degree:
            raise wrong(
                f"{self.experiments} temperatures cannot determine curves of degree {self.degree}.",
                "--experiments",
            )
        if self.target is not None and not self.target > 0.0:
            raise wrong(f"{self.target:g} is not above 0 ppm.", "--target")
        sizes = {"--step": self.step, "--density": self.density}
        for option, size in {**sizes, "--repeatability": self.repeatability}.items():
            if not size >= 0.0:
                raise wrong(f"{size:g} is below 0.", option)


def _find(
    help: str, default: str | None = None, metavar: str | None = None
) -> typer.models.OptionInfo:
    """An option of --optimise. Its default is filled in later, so that it shows whether it was given."""
    return typer.Option(
        help=help, metavar=metavar, show_default=default or False, rich_help_panel=_FIND
    )


def design(
    plan: Annotated[
        str | None,
        typer.Argument(
            metavar="PLAN",
            help="For --audit: campaign folder or campaign.toml, or a scenario of `inertiax simulate`: "
            "file or name. For --optimise: a campaign that shows noise, scatter, degree and temperatures. "
            "For --separate: the campaign, where it is not where it was diagnosed.",
        ),
    ] = None,
    audit: Annotated[
        bool,
        typer.Option(
            "--audit",
            help="Say what PLAN cannot observe, what it cannot tell apart, and from which size on it "
            "shows each effect.",
            rich_help_panel=_JUDGE,
        ),
    ] = False,
    assumed_noise: Annotated[
        bool,
        typer.Option(
            "--assumed-noise",
            help="Beside the white noise inside rests take a flicker of the same size instead of fitting "
            "slow noise to the recordings.",
            rich_help_panel=_JUDGE,
        ),
    ] = False,
    optimise: Annotated[
        bool,
        typer.Option(
            "--optimise",
            "--optimize",
            help="Find positions on a two-axis table, and temperatures, for the calibration of "
            "accelerometers by |a| = g.",
            rich_help_panel=_FIND,
        ),
    ] = False,
    positions: Annotated[int | None, _find("How many positions, 9 or more.", "18", "N")] = None,
    criterion: Annotated[
        str | None,
        _find(
            "D (all parameters together), A (their mean variance) or I (mean variance of |a|).",
            "D",
            "|".join(_CRITERIA),
        ),
    ] = None,
    outer: Annotated[
        Reach | None, _find("Reach of the outer axis, level and pointing east.", "all", "DEG DEG")
    ] = None,
    inner: Annotated[
        Reach | None, _find("Reach of the inner axis, up at outer angle 0.", "all", "DEG DEG")
    ] = None,
    step: Annotated[float | None, _find("What an axis can be set to.", "any", "DEG")] = None,
    experiments: Annotated[int | None, _find("How many temperatures.", "13", "N")] = None,
    degree: Annotated[int | None, _find("Of the curves over temperature.", "6", "N")] = None,
    low: Annotated[float | None, _find("Lowest temperature.", "-55", "°C")] = None,
    high: Annotated[float | None, _find("Highest temperature.", "60", "°C")] = None,
    target: Annotated[
        float | None,
        _find(
            "Half-width, 95 %, that every scale factor is to reach: how long does that take?",
            metavar="PPM",
        ),
    ] = None,
    density: Annotated[
        float | None, _find("White noise of the outputs, m/s²/√Hz.", "8e-5", "X")
    ] = None,
    repeatability: Annotated[
        float | None, _find("Scatter after re-positioning, m/s², 1 sigma.", "0", "X")
    ] = None,
    separate: Annotated[
        Path | None,
        typer.Option(
            metavar="DIAGNOSIS",
            help="diagnosis.json, or the folder that holds it: find the run that tells apart the names that it "
            "could not.",
            rich_help_panel=_PART,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        written(
            "DIR",
            "Of --separate: folder for scenario.toml, checklist.md and separation.json. --audit and --optimise write "
            "no file: they print, with --json for a script.",
            rich_help_panel=_PART,
        ),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Design experiments: judge a plan before it is run, or find one.

    `--audit PLAN` says which effects a plan shows from which size on, hides, or cannot tell apart.

    `--optimise` finds the positions and temperatures that determine the parameters best, and with
    `--target` the hours that a precision takes. With a campaign as PLAN, noise, scatter after re-positioning,
    temperatures and degree are those that it shows, where no option says otherwise. Angles are of a table whose outer
    axis lies level and points east and carries the inner one, which points up along the case's z at outer angle 0; both
    count right-handed: R = R_east(outer) R_up(inner).

    `--separate DIAGNOSIS` finds the run of an hour at most that tells apart what a diagnosis could not.
    """
    find = {
        "--positions": positions, "--criterion": criterion, "--outer": outer, "--inner": inner,
        "--step": step, "--experiments": experiments, "--degree": degree, "--low": low,
        "--high": high, "--target": target, "--density": density, "--repeatability": repeatability,
    }  # fmt: skip
    judge = {"PLAN": plan, "--assumed-noise": assumed_noise or None}
    if separate is not None:
        asked = {"--audit": audit or None, "--optimise": optimise or None}
        _check_foreign("--separate", {**asked, **find, "--assumed-noise": judge["--assumed-noise"]})
        _separate(separate, plan, output, as_json=as_json, quiet=quiet)
        return
    foreign = find if audit else {"--assumed-noise": judge["--assumed-noise"]}
    _check_question(plan, audit=audit, optimise=optimise, foreign={**foreign, "-o": output})
    if audit:
        _audit(str(plan), assumed_noise=assumed_noise, as_json=as_json, quiet=quiet)
        return
    shown = None if plan is None else _shown(plan, quiet=quiet)
    given = {
        "experiments": experiments, "degree": degree, "low": low, "high": high,
        "density": density, "repeatability": repeatability,
    }  # fmt: skip
    usual = _USUAL if shown is None else {name: getattr(shown, name) for name in _USUAL}
    wanted = Wanted(
        positions=_or(positions, 18),
        criterion=_or(criterion, "D"),
        outer=_or(outer, (-180.0, 180.0)),
        inner=_or(inner, (-180.0, 180.0)),
        step=_or(step, 0.0),
        target=target,
        **{name: _or(value, usual[name]) for name, value in given.items()},
    )
    wanted.check()
    _optimise(wanted, shown, as_json=as_json, quiet=quiet)


def _or(value: Given | None, default: Given) -> Given:
    return default if value is None else value


def _check_question(
    plan: str | None, *, audit: bool, optimise: bool, foreign: Mapping[str, object]
) -> None:
    """One question at a time, without options of the other; status 2 if not."""
    if audit == optimise:
        raise typer.BadParameter(
            ("only one of them: " if audit else "say what to do: ")
            + "--audit PLAN, --optimise or --separate DIAGNOSIS.",
            param_hint="'--audit' / '--optimise' / '--separate'",
        )
    if audit and plan is None:
        raise typer.BadParameter(
            "--audit needs a campaign or a scenario to judge.", param_hint="'PLAN'"
        )
    _check_foreign("--audit" if audit else "--optimise", foreign)


def _check_foreign(asked: str, foreign: Mapping[str, object]) -> None:
    for name, value in foreign.items():
        if value is not None:
            prints = ", which prints its answer; --json > FILE keeps it" if name == "-o" else ""
            raise typer.BadParameter(f"means nothing with {asked}{prints}.", param_hint=f"'{name}'")


def _separate(
    diagnosis: Path, plan: str | None, output: Path | None, *, as_json: bool, quiet: bool
) -> None:
    if output is not None:
        outputs.require_folder(output)
    with console.Stages(quiet=quiet) as stages, ExitStack() as stack:
        if output is not None:
            stack.enter_context(outputs.owned_results(output))
        stages("starting")
        environment.prepare()
        from ..data.campaign import load_campaign
        from ..diagnose.plan.separate import separate
        from ..diagnose.wording.separation import documents, lines, read_sets, write_separations

        if output is not None:
            file = diagnosis / "diagnosis.json" if diagnosis.is_dir() else diagnosis
            read = (file, None if plan is None else Path(plan))
            written = ("separation.json", "scenario.toml", "checklist.md")
            inputs_kept.require_kept(output, written, (x for x in read if x and not x.is_dir()))
        said = read_sets(diagnosis)
        place = said.campaign if plan is None else Path(plan)
        if place is None or not place.exists():
            raise typer.BadParameter(
                f"the campaign of '{diagnosis}' is not at '{place}'; name it.", param_hint="'PLAN'"
            )
        outputs.require_campaign(place)
        stages("reading recordings")
        campaign = load_campaign(place)
        if said.device in campaign.devices:
            campaign = campaign.of_device(said.device)
        found = [separate(campaign, one, said.beside(one), stages) for one in said.sets]
        if output is not None:
            write_separations(found, output)
    if as_json:
        outputs.print_json(documents(found))
    elif not quiet:
        console.say("\n".join(line for one in found for line in lines(one)))


def _shown(plan: str, *, quiet: bool) -> "Conditions":
    """What a campaign shows of the conditions of the plan to come."""
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..calibrate.pipeline import calibrate_device
        from ..design.shown_conditions import shown_by

        campaign = _campaign(plan, stages)
        device = campaign.devices[0]
        if len(campaign.devices) > 1:
            console.warn(
                f"the conditions of device '{device}' stand for those of the other devices"
            )
        return shown_by(calibrate_device(campaign.of_device(device), progress=stages))


def _optimise(wanted: Wanted, shown: "Conditions | None", *, as_json: bool, quiet: bool) -> None:
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..design import advise, TableLimits

        stages("optimising positions and temperatures")
        found = advise(
            wanted.positions,
            criterion=wanted.criterion,
            limits=TableLimits(
                (radians(wanted.outer[0]), radians(wanted.outer[1])),
                (radians(wanted.inner[0]), radians(wanted.inner[1])),
                radians(wanted.step),
            ),
            target=None if wanted.target is None else 1e-6 * wanted.target,
            density=wanted.density,
            repeatability=wanted.repeatability,
            experiments=wanted.experiments,
            degree=wanted.degree,
            low=wanted.low,
            high=wanted.high,
        )
    if as_json:
        outputs.print_json(found.as_dict() | ({} if shown is None else {"shown": shown.as_dict()}))
    elif not quiet:
        if shown is not None:
            console.say(f"PLAN shows {shown.line()}")
        console.say("\n".join(found.lines()))


def _audit(plan: str, *, assumed_noise: bool, as_json: bool, quiet: bool) -> None:
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..diagnose import audit as run

        campaign = _campaign(plan, stages)
        device = campaign.devices[0]
        if len(campaign.devices) > 1:
            console.warn(f"the plan of device '{device}' stands for those of the other devices")
        stages("auditing the plan")
        found = run(campaign.of_device(device), estimate_noise=not assumed_noise)
    if as_json:
        outputs.print_json(found.as_dict())
    elif not quiet:
        from ..report.text import print_audit

        print_audit(found)


def _campaign(plan: str, stages: console.Stages) -> "Campaign":
    """The campaign at a path, or one simulated by a scenario."""
    from ..data.campaign import load_campaign
    from ..simulate import load_scenario, SCENARIOS, write_campaign
    from ..storage.whole_files import scratch_folder

    path = Path(plan)
    if path.exists() and not _is_scenario(path):
        outputs.require_campaign(path)
        stages("reading recordings")
        return load_campaign(path)
    if not path.exists() and plan not in SCENARIOS:
        raise typer.BadParameter(
            f"'{plan}' does not exist; give a campaign, a scenario file or one of "
            f"{', '.join(SCENARIOS)}.",
            param_hint="'PLAN'",
        )
    with scratch_folder() as folder:
        simulated = folder / "campaign"
        write_campaign(
            load_scenario(plan), simulated, progress=lambda text: stages(f"simulating {text}")
        )
        stages("reading the simulated recordings")
        return load_campaign(simulated)


def _is_scenario(path: Path) -> bool:
    """Whether a file is a scenario: a campaign names its recordings' files."""
    if path.is_dir():
        return False
    try:
        content = tomllib.loads(path.read_text("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError):
        return False
    return "recordings" not in content
