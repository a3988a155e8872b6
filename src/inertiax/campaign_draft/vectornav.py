"""Sentences of VectorNav's sensors (`$VNIMU,...*6B`): which field is what, and in which unit.

**Reference:** VectorNav, VN-100 User Manual UM001, asynchronous outputs IMU (register 54), MAR (20), YMR (27), YBA and
YIA: magnetometers in gauss, accelerometers in m/s², gyros in rad/s, temperature in °C, pressure in kPa.
"""

from typing import NamedTuple

from .raw_log import RawLog


_ANGLES = ("yaw", "pitch", "roll")
_MAG, _ACCEL, _GYRO = (tuple(f"{t}_{a}" for a in "xyz") for t in ("mag", "accel", "gyro"))
_FIELDS = {
    "$VNIMU": (*_MAG, *_ACCEL, *_GYRO, "temperature", "pressure"),
    "$VNMAR": (*_MAG, *_ACCEL, *_GYRO),
    "$VNYMR": (*_ANGLES, *_MAG, *_ACCEL, *_GYRO),
}
_UNITS = {"mag": "gauss", "accel": "m/s^2", "gyro": "rad/s", "temperature": "[degC]"}
_WITHOUT_GRAVITY = ("$VNYBA", "$VNYIA")  # angles, then an acceleration from which gravity is taken
_FILTERED = "the sensor's own filter has corrected them: log $VNIMU for what it reads"


class VectorNav(NamedTuple):
    """What the columns of a log of one sentence are, and their units by column."""

    columns: dict[str, str]
    units: dict[str, str]
    notes: tuple[str, ...]

    @property
    def temperature(self) -> str | None:
        """The temperature's column."""
        return self.columns.get("temperature")

    def triad(self, kind: str) -> tuple[str, str, str]:
        """The three columns of "accel", "gyro" or "mag"."""
        x, y, z = (self.columns[f"{kind}_{a}"] for a in "xyz")
        return x, y, z


def vectornav(log: RawLog) -> VectorNav | None:
    """What the columns are; `None` for any other log.

    Raises `ValueError` for sentences that have no gravity in them.
    """
    first, words = next(iter(log.texts.items()), ("", ()))
    if log.has_header or len(words) != 1:
        return None
    (sentence,) = words
    if sentence in _WITHOUT_GRAVITY:
        raise ValueError(
            f"{log.path.name}: {sentence} holds an acceleration from which the sensor has taken gravity, which tells "
            "nothing of accelerometers; log $VNIMU."
        )
    fields = _FIELDS.get(sentence)
    number = int(first.removeprefix("column_"))
    names = (
        () if fields is None else tuple(f"column_{number + k}" for k in range(1, len(fields) + 1))
    )
    if fields is None or any(n not in log.numbers for n in names):
        return None
    columns = dict(zip(fields, names, strict=True))
    units = {n: _UNITS[kind] for f, n in columns.items() if (kind := f.split("_")[0]) in _UNITS}
    filtered = () if sentence == "$VNIMU" else (f"{sentence}: {_FILTERED}",)
    return VectorNav(columns, units, filtered)
