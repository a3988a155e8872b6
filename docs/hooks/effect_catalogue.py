"""The reference of the physical effects, from the catalogue that the diagnosis searches."""

from table_rows import table

from inertiax.effects import CATALOGUE
from inertiax.effects.effect import Effect


def tables() -> str:
    """Three tables, in the catalogue's order: physics, what shows an effect, units and usual sizes."""
    what, seen, sizes = [], [], []
    for effect in CATALOGUE:
        name = f"`{effect.name}`"
        settings = ", ".join(f"`{k}`" if v else f"(`{k}`)" for k, v in effect.settings.items())
        what.append((name, effect.title, _whose(effect), f"`{effect.equation}`", settings))
        seen.append((name, effect.needs, effect.separating))
        for triad in effect.triads:
            usual = [_range(effect.prior.get(triad, {}).get(g)) for g in GRADES]
            sizes.append((name, triad, effect.units[triad], *usual))
    parts = [
        table(
            ("name", "standards' term", "of", "adds to the outputs", "settings (may be left out)"),
            what,
        ),
        "## What shows an effect",
        table(("name", "is seen with", "unlike its rivals when you"), seen),
        "## Usual sizes",
        SIZES,
        table(("name", "triad", "unit", *GRADES), sizes),
    ]
    return "\n\n".join(parts)


GRADES = ("navigation", "tactical", "consumer")
SIZES = """Smallest and largest usual coefficient for each grade, in SI. They are orders of magnitude, not limits
of a standard or of a data sheet, and enter as a [weak prior](../explanation/diagnosis.md#limits)."""


def _whose(effect: Effect) -> str:
    if len(effect.triads) == 2:
        return "both triads"
    return "accelerometers" if effect.triads == ("accel",) else "gyros"


def _range(usual: tuple[float, float] | None) -> str:
    return "" if usual is None else f"{usual[0]:.2g} … {usual[1]:.2g}"
