"""Small operations on columns of rows: padding, unit length, an orthonormal basis."""

import numpy as np

from .signatures import bucket


def lengthen(rows: np.ndarray, width: int | None = None) -> np.ndarray:
    """The rows with zeros behind them up to a bucket size, and columns of zeros up to `width`."""
    made = np.zeros(
        (bucket(len(rows)), *rows.shape[1:]) if width is None else (bucket(len(rows)), width)
    )
    made[(slice(len(rows)), *(slice(n) for n in rows.shape[1:]))] = rows
    return made


def unit(columns: np.ndarray) -> np.ndarray:
    """The columns with unit length."""
    return columns / (np.linalg.norm(columns, axis=0) + 1e-300)


def span(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns' span, by the Gram matrix twice over."""
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0.0]
    for _ in range(2):
        if not columns.shape[1]:
            break
        columns = unit(columns)
        value, vector = np.linalg.eigh(columns.T @ columns)
        kept = value > 1e-12 * value[-1]
        columns = columns @ (vector[:, kept] / np.sqrt(value[kept]))
    return columns
