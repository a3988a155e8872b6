"""`inertiax plan`: an optimal programme of positions, and what a stated precision takes."""

from typing import Annotated

import typer

from . import console, environment, outputs
from .calibrate import AsJson, Quiet


def plan(
    positions: Annotated[int, typer.Option(min=9, help="How many positions to optimise.")] = 18,
    criterion: Annotated[
        str,
        typer.Option(help="D (all parameters together), A (their mean variance) or I (of |a|)."),
    ] = "D",
    target: Annotated[
        float | None,
        typer.Option(min=0.0, help="Half-width in ppm, 95 %, that every scale factor is to reach."),
    ] = None,
    density: Annotated[
        float, typer.Option(help="White noise of the accelerometers, m/s²/√Hz.")
    ] = 8e-5,
    repeatability: Annotated[
        float, typer.Option(help="Scatter after re-positioning, m/s², 1 sigma.")
    ] = 0.0,
    experiments: Annotated[int, typer.Option(min=1, help="Temperatures, in equal steps.")] = 13,
    degree: Annotated[int, typer.Option(min=0, help="Of the curves over temperature.")] = 6,
    low: Annotated[float, typer.Option(help="Lowest temperature, °C.")] = -55.0,
    high: Annotated[float, typer.Option(help="Highest temperature, °C.")] = 60.0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Optimise positions on a two-axis table for accelerometers (invariant estimator)."""
    if criterion not in ("D", "A", "I"):
        raise typer.BadParameter("it is D, A or I.", param_hint="'--criterion'")
    if experiments <= degree:
        raise typer.BadParameter(
            f"{experiments} temperatures cannot determine curves of degree {degree}.",
            param_hint="'--experiments'",
        )
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..design.advise import advise

        stages("optimising positions")
        found = advise(
            positions,
            criterion=criterion,
            target=None if target is None else 1e-6 * target,
            density=density,
            repeatability=repeatability,
            experiments=experiments,
            degree=degree,
            low=low,
            high=high,
        )
    if as_json:
        outputs.print_json(found.as_dict())
    elif not quiet:
        typer.echo("\n".join(found.lines()))
