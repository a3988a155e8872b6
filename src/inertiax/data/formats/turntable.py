"""How a table stands, and how its clock runs: the `[table]` table of a campaign."""

from typing import Literal

import msgspec


Direction = str | tuple[float, float, float]


class Turntable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[table]`: axes (outermost first) and the device's x, y, z as they point in the room with all angles zero, as
    words or as vectors (east, north, up); `azimuth` is where what is called north points, deg clockwise of true north,
    and `delay` by how much the stamps of the angles are late, one number for all files or one for each. A log of the
    table's own may be on a clock that runs `drift` ppm faster; its delay is then that at the log's first stamp.
    """

    axes: tuple[Direction, ...] = ()
    case: tuple[Direction, Direction, Direction] = ("east", "north", "up")
    azimuth: float | None = None  # zero where table_rates are stated
    delay: float | tuple[float, ...] = 0.0  # s; a number where a file is read (`of_file`)
    drift: float | tuple[float, ...] = 0.0  # ppm; likewise

    def of_file(self, number: int, files: int) -> "Turntable":
        """The same with delay and drift of one of the files. Raises `ValueError` where there are not as many."""
        one = {}
        for key in ("delay", "drift"):
            said = getattr(self, key)
            if not isinstance(said, tuple):
                continue
            if len(said) != files:
                raise ValueError(
                    f"[table] {key} has {len(said)} numbers but [recordings] files names {files}; give one for all, or "
                    "one for each, in their order."
                )
            one[key] = said[number]
        return msgspec.structs.replace(self, **one) if one else self

    @property
    def one_delay(self) -> float:
        """The delay, s. Raises `ValueError` where there is one for each file, and nobody said of which."""
        return self._one("delay")

    @property
    def one_drift(self) -> float:
        """The drift, ppm. Raises `ValueError` as `one_delay`."""
        return self._one("drift")

    def _one(self, key: Literal["delay", "drift"]) -> float:
        said = getattr(self, key)
        if isinstance(said, tuple):
            raise ValueError(
                f"[table] {key} has a number for each of [recordings] files; of this one give a single number."
            )
        return said
