"""The reference of the physical effects, from the catalogue that the diagnosis searches."""

from inertiax.effects import CATALOGUE
from inertiax.effects.effect import Effect


def tables() -> str:
    """Two tables, in the catalogue's order: the physics of each effect, and its units and usual sizes."""
    what = ["| name | standards' term | of | adds to the outputs |", "|---|---|---|---|"]
    seen = ["| name | is seen with | unlike its rivals when you |", "|---|---|---|"]
    sizes = [
        "| name | triad | unit | navigation | tactical | consumer |",
        "|---|---|---|---|---|---|",
    ]
    for effect in CATALOGUE:
        what.append(_row(f"`{effect.name}`", effect.title, _whose(effect), f"`{effect.equation}`"))
        seen.append(_row(f"`{effect.name}`", effect.needs, effect.separating))
        for triad in effect.triads:
            usual = [_range(effect.prior.get(triad, {}).get(g)) for g in GRADES]
            sizes.append(_row(f"`{effect.name}`", triad, effect.units[triad], *usual))
    return "\n".join(
        [
            *what,
            "",
            "## What shows an effect",
            "",
            *seen,
            "",
            "## Usual sizes",
            "",
            SIZES,
            "",
            *sizes,
        ]
    )


GRADES = ("navigation", "tactical", "consumer")
SIZES = """Smallest and largest usual coefficient for each grade, in SI. They are orders of magnitude, not limits
of a standard or of a data sheet, and enter as a [weak prior](../explanation/diagnosis.md#limits)."""


def _whose(effect: Effect) -> str:
    if len(effect.triads) == 2:
        return "both triads"
    return "accelerometers" if effect.triads == ("accel",) else "gyros"


def _range(usual: tuple[float, float] | None) -> str:
    return "" if usual is None else f"{usual[0]:.2g} … {usual[1]:.2g}"


def _row(*cells: str) -> str:
    return "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"
