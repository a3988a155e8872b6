"""Sums over stretches of rows: dwells cut into blocks, the blocks of many devices in one array.

The scatter of block means within dwells, by successive differences (an Allan variance at the block's
length), pooled over a device, gives the covariance of its dwells' means: noise that is correlated for less
than a block is counted rightly, and a slow drift within a dwell is not taken for noise.
"""

import equinox as eqx
import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int


BLOCKS = 16  # of a dwell
FEWEST = 4  # samples in a block
_PIECES = 64  # of a column; of more each is too short for sums of its own


class Blocks(eqx.Module):
    """Dwells cut into blocks of equal length; what is left over at a dwell's end joins its last block.

    Dwells of one device follow one another. At least one dwell.
    """

    device: Int[np.ndarray, " dwell"]  # number of each dwell's device
    start: Int[np.ndarray, " dwell"]  # first row of each dwell
    pieces: Int[np.ndarray, " dwell"]
    first: Int[np.ndarray, " dwell"]  # number of each dwell's first block
    edge: Int[np.ndarray, " block"]  # first row of each block
    count: Float[np.ndarray, " block"]  # samples
    samples: Float[np.ndarray, " dwell"]
    devices: Int[np.ndarray, " present"]  # numbers of the devices with dwells, increasing
    first_dwell: Int[np.ndarray, " present"]
    num_dwells: Int[np.ndarray, " present"]

    @classmethod
    def cut(cls, device: np.ndarray, start: np.ndarray, stop: np.ndarray) -> "Blocks":
        """Dwells from row `start` to before `stop`, with the number of each dwell's device."""
        count = stop - start
        pieces = np.clip(count // FEWEST, 1, BLOCKS)
        first = np.cumsum(pieces) - pieces
        owner = np.repeat(np.arange(len(start)), pieces)
        within = np.arange(len(owner)) - first[owner]
        edge = start[owner] + within * count[owner] // pieces[owner]
        end = start[owner] + (within + 1) * count[owner] // pieces[owner]
        size = (end - edge).astype(float)
        devices, first_dwell, num_dwells = np.unique(device, return_index=True, return_counts=True)
        return cls(
            device, start, pieces, first, edge, size, np.add.reduceat(size, first), devices, first_dwell, num_dwells
        )  # fmt: skip

    @property
    def first_block(self) -> Int[np.ndarray, " present"]:
        """Number of each device's first block."""
        return self.first[self.first_dwell]

    @property
    def num_blocks(self) -> Int[np.ndarray, " present"]:
        """Blocks of each device."""
        return np.diff(np.append(self.first_block, len(self.edge)))

    def means(self, series: pl.Series) -> Float[np.ndarray, " block"]:
        """Means over the blocks; not finite where a block has a gap or a number that is not."""
        series = series.cast(pl.Float64, strict=False)
        if series.null_count():
            series = series.fill_null(float("nan"))
        if series.n_chunks() > _PIECES:
            series = series.rechunk()
        end = self.edge + self.count.astype(int)
        sums = np.empty(len(end))
        row = left = 0  # before the piece; and the first block that has no sum yet
        # Piece by piece as they were decoded: to copy them together takes as long as to sum them.
        for piece in series.get_chunks():
            first = int(np.searchsorted(self.edge, row))
            row += len(piece)
            last = int(np.searchsorted(end, row, side="right"))
            for k in range(left, min(first, last)):  # begun before the piece
                apart = series.slice(int(self.edge[k]), int(end[k] - self.edge[k])).to_numpy()
                sums[k] = np.add.reduceat(apart, [0])[0]
            if last > first:
                start = row - len(piece)
                mine = slice(first, last)
                sums[mine] = _sums(piece.to_numpy(), self.edge[mine] - start, end[mine] - start)
            left = max(left, last)
        return sums / self.count

    def over_dwells(self, means: Float[np.ndarray, " block"]) -> Float[np.ndarray, " dwell"]:
        """Means over dwells from those over blocks."""
        return np.add.reduceat(means * self.count, self.first) / self.samples

    def variance(self, means: Float[np.ndarray, " block"]) -> Float[np.ndarray, " present"]:
        """Variance of one block's mean, by successive differences within dwells, pooled over a device; 0 where
        every dwell is one block."""
        same = np.ones(len(means), bool)
        same[self.first] = False  # from one dwell to the next
        square = np.square(np.diff(means, prepend=means[:1])[same])
        counts = self.num_blocks - self.num_dwells
        return np.where(counts > 0, means_of_runs(square, counts) / 2.0, 0.0)

    def held(
        self, means: Float[np.ndarray, " block"], *, highest: bool
    ) -> Int[np.ndarray, " present"]:
        """For each device the number of dwells through which a column stays exactly at its extreme value."""
        low, high = np.minimum.reduceat(means, self.first), np.maximum.reduceat(means, self.first)
        of_dwells, of = (high, np.maximum) if highest else (low, np.minimum)
        extreme = np.repeat(of.reduceat(of_dwells, self.first_dwell), self.num_dwells)
        stuck = (low == high) & (low == extreme) & (self.pieces > 1)
        return np.add.reduceat(stuck.astype(int), self.first_dwell)

    def any_of_device(self, dwells: Bool[np.ndarray, " dwell"]) -> Bool[np.ndarray, " present"]:
        """Whether a statement holds for any dwell of each device."""
        return np.logical_or.reduceat(dwells, self.first_dwell)


def _sums(
    values: Float[np.ndarray, " row"],
    edge: Int[np.ndarray, " block"],
    end: Int[np.ndarray, " block"],
) -> Float[np.ndarray, " block"]:
    """Sums from each `edge` to before its `end`, which follow one another."""
    apart = end[:-1] != edge[1:]
    place: slice | np.ndarray = slice(len(edge))
    cuts = edge
    if apart.any():  # sums between consecutive cuts hold the rows between dwells too
        place = np.arange(len(edge))
        place[1:] += np.cumsum(apart)
        cuts = np.empty(place[-1] + 1, edge.dtype)
        cuts[place] = edge
        cuts[place[:-1][apart] + 1] = end[:-1][apart]
    if end[-1] < len(values):
        cuts = np.append(cuts, end[-1])
    return np.add.reduceat(values, cuts)[place]


def means_of_runs(
    values: Float[np.ndarray, " value"], counts: Int[np.ndarray, " run"]
) -> Float[np.ndarray, " run"]:
    """Mean of each run of consecutive values; NaN for an empty run.

    Runs of one length at once: each is then summed as if it were alone, so that a device's numbers do not depend on
    its neighbours.
    """
    result = np.full(len(counts), np.nan)
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]):
        mine = np.flatnonzero(counts == count)
        result[mine] = values[starts[mine][:, None] + np.arange(count)].mean(axis=1)
    return result
