"""Units of coefficients by an effect's form: what a coefficient multiplies decides what it is in."""

from collections.abc import Callable, Mapping


OUTPUT = {"accel": "m/s^2", "gyro": "rad/s"}
INPUT = {"accel": "g", "gyro": "(rad/s)"}  # as `Signal.input` has it
Settings = Mapping[str, float | int | str]
# Unit of one column's coefficient, from that on the bias, the triad, the form's settings and the column's number.
UnitOfForm = Callable[[str, str, Settings, int], str]

# What a form acts on, by its setting `on`: as a sentence says it.
ACTS_ON = {
    "bias": "the bias",
    "gradient": "the bias",
    "scale": "the scale factor",
    "misalignment": "the misalignments",
}


def acts_on(settings: Settings) -> str | None:
    """What a form acts on, in words; `None` where its effect has one form only of what it adds to."""
    return ACTS_ON.get(str(settings.get("on", "")))


def by_what_it_acts_on(unit: str, triad: str, settings: Settings, column: int) -> str:
    """Of a form on the bias as it is; else without the output's unit, which its input times has.

    A change of the scale factor is a part of 1, one of a misalignment an angle: `m/s^2/s` on the bias is `1/s` on the
    scale factor and `rad/s` on a misalignment. Raises `ValueError` for a unit that does not begin with the output's.
    """
    del column
    on = settings["on"]
    if on not in ("scale", "misalignment"):
        return unit
    if not unit.startswith(OUTPUT[triad]):
        raise ValueError(f"{unit!r} does not begin with the unit of the outputs, {OUTPUT[triad]}.")
    return ("1" if on == "scale" else "rad") + unit.removeprefix(OUTPUT[triad])


def per_input(triad: str) -> str:
    """Unit of a coefficient of the triad's input."""
    return f"(rad/s)/{INPUT[triad]}" if triad == "gyro" else f"{OUTPUT[triad]}/{INPUT[triad]}"
