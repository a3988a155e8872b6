"""Raw columns of a log that give way to the compensated ones of their names."""

from collections.abc import Mapping

import numpy as np
import polars as pl

from ..data.recording import Recording


def replaced_columns(
    table: pl.DataFrame, recording: Recording, units: Mapping[str, str], name: str
) -> tuple[str, ...]:
    """In words, where raw columns give way to compensated ones of their name while others stay, or in other units."""
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
