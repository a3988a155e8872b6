"""The precision that is asked for: `accel.bias=0.3 mg, accel.scale=200 ppm`.

A target is what the error of every named parameter is to stay below, with a probability of 95 % for all of them
together (`posterior.Posterior.within`).
"""

import dataclasses
import fnmatch
import math
import re

from ..data.formats.columns import MAG_UNITS, nearest
from ..storage.wrong_value import WrongValue


GRAVITY = 9.80665  # m/s², of a mg: the standard one, as sensor makers use it
CONFIDENCE = 0.95  # that the errors of all named parameters together are within their targets

_DEGREE = math.pi / 180.0
_ACCELERATION = {
    "m/s^2": 1.0,
    "m/s2": 1.0,
    "m/s²": 1.0,
    "g": GRAVITY,
    "mg": 1e-3 * GRAVITY,
    "ug": 1e-6 * GRAVITY,
    "µg": 1e-6 * GRAVITY,
}
_RATE = {"rad/s": 1.0, "deg/s": _DEGREE, "deg/h": _DEGREE / 3600.0}
_RATIO = {"ppm": 1e-6, "%": 1e-2, "1": 1.0}
_ANGLE = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "µrad": 1e-6,
    "deg": _DEGREE,
    "arcmin": _DEGREE / 60.0,
    "arcsec": _DEGREE / 3600.0,
}
_BY_FORCE = {f"{unit}/g": size for unit, size in _RATE.items()}
_KINDS = {
    "accel": ("bias", "scale", "misalignment", "matrix"),
    "gyro": ("bias", "scale", "misalignment", "matrix", "g_sensitivity"),
    "mag": ("bias", "scale", "misalignment", "matrix"),
}
_NAME = re.compile(
    r"(?:(?:accel|gyro|mag)\.(?:(bias)\[[0-2]\]|(matrix)\[([0-2]),([0-2])\])|gyro\.(g_sensitivity)\[[0-2],[0-2]\])"
)
_AMOUNT = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(\S+)")

# Where nobody says what is wanted: a tenth of what such devices are off by, from data sheets (convention). Nothing of
# the gyros: their biases change from power-on to power-on, and their matrix needs turns that a slow log does not hold.
USUAL = {
    "consumer": "accel.bias=2 mg, accel.scale=1000 ppm, accel.misalignment=1 mrad",
    "tactical": "accel.bias=0.2 mg, accel.scale=100 ppm, accel.misalignment=0.1 mrad",
    "navigation": "accel.bias=20 ug, accel.scale=20 ppm, accel.misalignment=5 arcsec",
}


@dataclasses.dataclass(frozen=True)
class Target:
    """What is asked of each parameter, as written and in SI, in the order in which it was said."""

    text: str
    limits: tuple[tuple[str, float], ...]  # name of a group or a parameter, m/s², rad/s, 1 or rad
    usual_for: str | None = None  # the grade whose usual target this is; `None`: the user's own

    def limit(self, parameter: str) -> float | None:
        """The limit of a parameter such as `accel.matrix[1,0]`, SI; the last one said that names it.

        `None` where it may be anything.
        """
        found = [limit for name, limit in self.limits if covers(name, parameter)]
        return found[-1] if found else None


def usual_target(grade: str | None) -> Target:
    """What is asked for where nobody says it, by the campaign's `[device] grade`."""
    grade = grade or "consumer"
    return dataclasses.replace(parse_target(USUAL[grade]), usual_for=grade)


def parse_target(text: str) -> Target:
    """A target from its text, entries separated by commas.

    Raises `WrongValue`, a `ValueError` of one line that repeats the entry, for an unknown name or unit and for a limit
    that is not above zero.
    """
    limits: list[tuple[str, float]] = []
    entries = [e.strip() for e in re.split(r",(?![^\[]*\])", text)]
    for entry in entries:
        name, equals, amount = (part.strip() for part in entry.partition("="))
        if not equals or not name or not amount:
            raise WrongValue(
                f'target "{entry}": write a name, "=" and a limit with its unit, such as '
                '"accel.bias=0.3 mg, accel.scale=200 ppm".'
            )
        try:
            limit = parse_limit(name, amount, f'target "{entry}"')
        except ValueError as error:
            raise WrongValue(str(error)) from None
        if name.startswith("mag."):
            raise WrongValue(
                f'target "{entry}": a session follows accelerometers and gyros alone; magnetometers are calibrated '
                "from its recording."
            )
        if name.startswith("gyro.g_sensitivity"):
            raise WrongValue(
                f'target "{entry}": rests alone do not tell it while they are recorded; it is for the requirements of '
                "`inertiax protocol`."
            )
        limits.append((name, limit))
    return Target(text.strip(), tuple(limits))


def parse_limit(name: str, amount: str, where: str) -> float:
    """A limit such as "0.3 mg" of a family or a parameter, in m/s², rad/s, T, 1, rad or rad/s per g.

    Raises `ValueError`, one line that begins with `where`, for an unknown name or unit, or a limit not above zero.
    """
    return _amount(_known_name(name, where), amount, where)


def written_unit(name: str, amount: str) -> tuple[float, str] | None:
    """The size, SI, and the name of the unit in which a limit of `parse_limit` is written; `None` where it is none."""
    found = _AMOUNT.fullmatch(amount.strip())
    size = None if found is None else _units(name).get(found[2])
    return None if found is None or size is None else (size, found[2])


def kind_of(parameter: str) -> str:
    """ "bias", "scale" (diagonal of a matrix), "misalignment" (off it) or "g_sensitivity"."""
    found = _NAME.fullmatch(parameter)
    if found is None:
        raise ValueError(f"`kind_of({parameter!r})`: is no parameter, such as accel.matrix[1,0].")
    if found[2] is None:
        return found[1] or found[5]
    return "scale" if found[3] == found[4] else "misalignment"


def _known_name(name: str, where: str) -> str:
    groups = [f"{triad}.{kind}" for triad, kinds in _KINDS.items() for kind in kinds]
    if name in groups or _NAME.fullmatch(name):
        return name
    raise ValueError(
        f"{where}: {name!r} is no parameter; {nearest(name, groups)}one of {', '.join(groups)}, or one "
        "element such as accel.bias[0] or gyro.matrix[2,1]."
    )


def _amount(name: str, amount: str, where: str) -> float:
    units = _units(name)
    found = _AMOUNT.fullmatch(amount)
    if found is None:
        raise ValueError(
            f"{where}: {amount!r} is no number with a unit; units of {name} are {', '.join(units)}."
        )
    unit = found[2]
    if unit not in units:
        raise ValueError(
            f"{where}: unit {unit!r} does not belong to {name}; {nearest(unit, units)}use one of "
            f"{', '.join(units)}."
        )
    try:
        value = float(found[1])
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{where}: the limit must be a number above 0.")
    return value * units[unit]


def _units(name: str) -> dict[str, float]:
    kind = kind_of(name) if "[" in name else name.partition(".")[2]
    if kind == "bias":
        return {"accel": _ACCELERATION, "gyro": _RATE, "mag": MAG_UNITS}[name.partition(".")[0]]
    if kind == "g_sensitivity":
        return _BY_FORCE
    if kind == "matrix":
        return {**_RATIO, **_ANGLE}
    return _RATIO if kind == "scale" else _ANGLE


def covers(name: str, parameter: str) -> bool:
    """Whether a name, of a family such as `accel.scale` or of an element, includes a parameter."""
    triad, _, kind = name.partition(".")
    if not parameter.startswith(f"{triad}.") or _NAME.fullmatch(parameter) is None:
        return False
    if "[" in kind:
        return name == parameter
    if kind == "matrix":
        return fnmatch.fnmatchcase(parameter, f"{triad}.matrix*")
    return kind_of(parameter) == kind
