"""`inertiax live --plan`: how many rests a target needs, before one begins."""

from pathlib import Path

import typer

from . import console, environment, outputs
from .live_lines import ENDS


def tell(
    campaign: Path, target: str | None, noise: str | None, hold: float, *, as_json: bool
) -> None:
    """Print rests and minutes by the noise of a rest's mean."""
    environment.prepare()
    from ..data.campaign import load_settings
    from ..live.accel_rows import ByMagnitude, ByReference
    from ..live.rests_ahead import rests_ahead, TURN, usual_noises
    from ..live.target import GRAVITY, parse_limit, parse_target, usual_target

    settings, _ = load_settings(campaign)
    asked = usual_target(settings.grade) if target is None else parse_target(target)
    if settings.model.accel_estimator in ("none", "static"):
        raise ValueError("--plan: [model] has accelerometers that no direction of gravity tells.")
    by_reference = settings.model.accel_estimator == "reference"
    model = (ByReference if by_reference else ByMagnitude)(settings.site.gravity)
    each = usual_noises(asked, model)
    if noise is not None:
        try:
            each = [parse_limit("accel.bias", noise, "--noise")]
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="'--noise'") from None
    found = [rests_ahead(asked, model, settings.grade, one) for one in each]
    long = hold + ENDS + TURN  # s from one rest to the next
    seconds = [None if f.rests is None else long * f.rests for f in found]
    if as_json:
        rows = [
            {"noise": f.noise, "rests": f.rests, "seconds": s}
            for f, s in zip(found, seconds, strict=True)
        ]
        outputs.print_json({"target": asked.text, "limits": dict(asked.limits), "plan": rows})
        return
    console.say(f"target: {asked.text}; {len(model.names)} unknowns of the accelerometers")
    console.say(f"{'noise of a rest':>15}  {'rests':>5}  {'minutes':>7}")
    for one, took in zip(found, seconds, strict=True):
        size = f"{1e3 * one.noise / GRAVITY:.3g} mg"
        if one.rests is None or took is None:
            console.say(f"{size:>15}  more than a person makes")
        else:
            console.say(f"{size:>15}  {one.rests:>5}  {took / 60.0:>7.1f}")
