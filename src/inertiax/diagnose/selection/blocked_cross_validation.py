"""Which explanation predicts stretches of time that its coefficients were not fitted to.

A random walk can imitate every slow effect, and a jump in time the corner of a thermal loop; the likelihood
may then prefer a moment in time and a walk to one smooth dependence that explains the same rows. What
tells them apart is prediction: physics that depends on what the device goes through holds in a stretch
of time that was left out, a walk's course does not. Errors within one stretch go together, so that each
stretch counts as a single observation of the logarithm of the ratio.

**Reference:** Roberts et al., *Cross-validation strategies for data with temporal structure*, Ecography 40
(2017) 913.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..candidates.signatures import Term
from ..noise.observation_series import System


PARTITIONS = (
    6,
    10,
    16,
)  # numbers of stretches; one number alone would favour what fits its borders
STRETCHES = 8.0  # that count as independent observations
WEAK = 1e-9  # part of a direction's square that must remain beside a stretch for a coefficient


def stretches(time: Float[np.ndarray, " block"], number: int) -> tuple[slice, ...]:
    """The blocks of each stretch that has any: contiguous, of equal duration."""
    part = (time - time[0]) / max(float(time[-1] - time[0]), 1e-9)
    of_block = np.minimum((part * number).astype(int), number - 1)
    edges = np.r_[0, np.flatnonzero(np.diff(of_block)) + 1, len(time)].tolist()
    return tuple(slice(a, b) for a, b in zip(edges[:-1], edges[1:]))


@dataclass(frozen=True, eq=False)
class Foresight:
    """One chain's rows, ready for predictions by any columns beside the baseline.

    Rows are weighted by the white noise only: nothing but the columns may follow what is slow.
    """

    weight: Float[np.ndarray, " block"]
    stretches: tuple[tuple[slice, ...], ...]  # of every partition
    frame: Float[np.ndarray, "block size"]  # orthonormal columns of the weighted baseline
    rows: Float[np.ndarray, " block"]  # weighted, the baseline taken away

    def errors(
        self, columns: Float[np.ndarray, "block column"] | None
    ) -> Float[np.ndarray, " partition"]:
        """Sum of squares of every stretch's rows predicted from the others, for each partition."""
        z = self.frame
        if columns is not None:
            z = np.concatenate([z, self._beside(columns)], axis=1)
        gram, part = z.T @ z, z.T @ self.rows
        every = [here for partition in self.stretches for here in partition]
        own = np.stack([z[here].T @ z[here] for here in every])
        along = np.stack([z[here].T @ self.rows[here] for here in every])
        solution = _least_squares(gram - own, part - along)
        total, first = np.zeros(len(self.stretches)), 0
        for n, partition in enumerate(self.stretches):
            mine = solution[first : first + len(partition)]
            first += len(partition)
            of_row = np.repeat(mine, [here.stop - here.start for here in partition], axis=0)
            total[n] = np.square(self.rows - np.einsum("nk,nk->n", z, of_row)).sum()
        return total

    @cached_property
    def alone(self) -> Float[np.ndarray, " partition"]:
        """`errors` of the baseline."""
        return self.errors(None)

    def errors_each(
        self, columns: Float[np.ndarray, "block column"]
    ) -> Float[np.ndarray, "partition column"]:
        """As `errors`, for every column alone; all columns together in matrix products.

        The border of each normal equation is eliminated: the coefficient of a column is its product with
        the rows over its square, both with the baseline of the other stretches taken away.
        """
        z = columns * self.weight[:, None]
        z = z / (np.linalg.norm(z, axis=0) + 1e-300)
        z = z - self.frame @ (self.frame.T @ z)
        z = z / np.maximum(np.linalg.norm(z, axis=0), 1e-300)
        f = self.frame
        gram, part, along = f.T @ f, f.T @ self.rows, z.T @ self.rows
        total = np.zeros((len(self.stretches), z.shape[1]))
        for n, partition in enumerate(self.stretches):
            for here in partition:
                x, y, own = f[here], self.rows[here], z[here]
                border = -(x.T @ own)
                right = np.concatenate([(part - x.T @ y)[:, None], border], axis=1)
                solved = np.linalg.lstsq(gram - x.T @ x, right, rcond=WEAK)[0]
                square = 1.0 - np.square(own).sum(axis=0) - (border * solved[:, 1:]).sum(axis=0)
                product = along - own.T @ y - border.T @ solved[:, 0]
                size = np.where(square > WEAK, product / np.maximum(square, WEAK), 0.0)
                left = (y - x @ solved[:, 0])[:, None] - size * (own - x @ solved[:, 1:])
                total[n] += np.square(left).sum(axis=0)
        return total

    def _beside(self, columns: np.ndarray) -> np.ndarray:
        """The weighted columns with the baseline projected out, orthonormal."""
        z = columns * self.weight[:, None]
        z = z / (np.linalg.norm(z, axis=0) + 1e-300)
        z = z - self.frame @ (self.frame.T @ z)
        value, vector = np.linalg.eigh(z.T @ z)
        kept = value > 1e-6 * max(float(value[-1]), 1e-300)
        return z @ (vector[:, kept] / np.sqrt(value[kept]))


def _least_squares(
    gram: Float[np.ndarray, "stretch size size"], part: Float[np.ndarray, "stretch size"]
) -> Float[np.ndarray, "stretch size"]:
    """The shortest solution of each normal equation, without directions of which next to nothing is told."""
    value, vector = np.linalg.eigh(gram)
    size = np.abs(value)
    told = size > WEAK * size.max(axis=1, keepdims=True)
    along = (vector.transpose(0, 2, 1) @ part[:, :, None])[:, :, 0]
    scaled = np.where(told, along / np.where(told, value, 1.0), 0.0)
    return (vector @ scaled[:, :, None])[:, :, 0]


def foresights(system: System) -> list[Foresight]:
    """One `Foresight` per chain of the observed rows."""
    made = []
    for c, chain in enumerate(system.chains):
        time = np.cumsum(chain.gap)
        weight = 1.0 / np.sqrt(chain.white)
        frame = np.linalg.qr(system.frames[c] * weight[:, None])[0]
        rows = system.base.observed[c] * weight
        rows = rows - frame @ (frame.T @ rows)
        parts = tuple(stretches(time, number) for number in PARTITIONS)
        made.append(Foresight(weight, parts, frame, rows))
    return made


def columns_of(terms: Sequence[Term], chain: int) -> Float[np.ndarray, "block column"] | None:
    """The columns that some terms have on one chain, side by side; `None` where they have none."""
    mine = [t.columns[t.chains.index(chain)] for t in terms if chain in t.chains]
    return np.concatenate(mine, axis=1) if mine else None


def skill(one: Foresight, columns: Float[np.ndarray, "block column"] | None) -> float:
    """Half the logarithm of the ratio of squared errors, baseline alone to baseline with the columns: a mean
    over partitions."""
    if columns is None:
        return 0.0
    return float(np.mean(0.5 * np.log(one.alone / one.errors(columns))))


def skills(one: Foresight, terms: Sequence[Term], chain: int) -> Float[np.ndarray, " term"]:
    """`skill` of each term of one chain alone."""
    made = np.zeros(len(terms))
    columns = [t.columns[t.chains.index(chain)] for t in terms]
    single = [k for k, c in enumerate(columns) if c.shape[1] == 1]
    if single:
        errors = one.errors_each(np.concatenate([columns[k] for k in single], axis=1))
        made[single] = np.mean(0.5 * np.log(one.alone[:, None] / errors), axis=0)
    for k, column in enumerate(columns):
        if column.shape[1] != 1:
            made[k] = skill(one, column)
    return made
