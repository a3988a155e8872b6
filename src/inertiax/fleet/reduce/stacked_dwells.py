"""Devices' dwells in one array: padded to a length that many devices share."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from ...reduction.dwells import Dwells


def stack_dwells(devices: Sequence[Dwells], length: int | None = None) -> Dwells:
    """One `Dwells` with a leading device axis, each padded by its last row with `valid` False.

    `length` defaults to the longest, rounded up to a few values so that compiled programs are shared.
    Raises `ValueError` where a device has more dwells than `length`.
    """
    longest = max(d.num_dwells for d in devices)
    length = shared_length(longest) if length is None else length
    if longest > length:
        raise ValueError(f"`stack_dwells(length={length})`: a device has {longest} dwells.")
    padded = [_pad(d, length) for d in devices]
    return jax.tree.map(lambda *x: np.stack(x), *padded)


def shared_length(count: int) -> int:
    """The next of 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, …: at most a fifth of padding."""
    grain = max(2 ** (max(count - 1, 1).bit_length() - 3), 2)
    return max(-(-count // grain) * grain, 8)


def _pad(dwells: Dwells, length: int) -> Dwells:
    count = dwells.num_dwells
    rows = np.minimum(np.arange(length), count - 1)
    padded = jax.tree.map(lambda x: np.asarray(x)[rows], dwells)
    return eqx.tree_at(lambda d: d.valid, padded, padded.valid & (np.arange(length) < count))
