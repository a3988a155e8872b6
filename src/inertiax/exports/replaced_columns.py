"""Raw columns of a log that give way to the compensated ones of their names."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from jaxtyping import Float

from ..data.recording import Recording


def replaced_columns(
    table: pl.DataFrame, recording: Recording, units: Mapping[str, str], name: str
) -> tuple[str, ...]:
    """In words, where raw columns give way to compensated ones of their name while others stay, or in other units, and
    where the log's own time or temperature is not what was read."""
    return _outputs(table, recording, units, name) + _read_apart(table, recording, name)


def _read_apart(table: pl.DataFrame, recording: Recording, name: str) -> tuple[str, ...]:
    """Of a time or a temperature that was not read from the column of its name: rows were counted, stamps were mended,
    another column or log was mapped."""
    read = {"time": recording.time}
    if recording.temperature is not None:
        read["temperature"] = recording.temperature[:, 0]
    lost = [
        column
        for column, values in read.items()
        if column in table.columns
        and table[column].dtype.is_numeric()
        and not _same_in_other_units(table[column].cast(pl.Float64).to_numpy(), values)
    ]
    return tuple(
        f"{name}: its own column {column} is replaced by the {column} that was read "
        f"({'rows counted, stamps mended or another column' if column == 'time' else 'another column or log'}); "
        "rename the raw one before to keep both"
        for column in lost
    )


def _same_in_other_units(own: Float[np.ndarray, " row"], read: Float[np.ndarray, " row"]) -> bool:
    """Whether what was read is a straight line of the column's values, so that nothing is lost."""
    if not np.isfinite(own).all():
        return False
    low, high = int(np.argmin(own)), int(np.argmax(own))
    span = own[high] - own[low]
    if span == 0.0:
        return bool(np.ptp(read) == 0.0)
    line = read[low] + (read[high] - read[low]) * ((own - own[low]) / span)
    return bool(np.allclose(line, read, rtol=1e-9, atol=1e-9 * np.ptp(read)))


def _outputs(
    table: pl.DataFrame, recording: Recording, units: Mapping[str, str], name: str
) -> tuple[str, ...]:
    first = lambda triad: triad if triad == "pressure" else f"{triad}_x"
    own = [triad for triad in units if first(triad) in table.columns]
    if not own:
        return ()

    def rescaled(triad: str) -> bool:
        values = getattr(recording, triad)
        values = values if values.ndim == 1 else values[:, 0]
        column = table[first(triad)].cast(pl.Float64, strict=False).to_numpy()
        return not np.allclose(column, values, rtol=1e-12, atol=0.0, equal_nan=True)

    if len(own) == len(units) and not any(map(rescaled, own)):
        return ()
    names = ", ".join(t if t == "pressure" else f"{t}_x/y/z" for t in own)
    return (
        f"{name}: its own columns {names} are replaced by the compensated ones, which have their names; rename the raw "
        "ones before to keep both",
    )
