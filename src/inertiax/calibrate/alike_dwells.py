"""Errors that fade from dwell to dwell: whitening and products in proportion to the number of dwells.

    K_ij = exp(-|t_i - t_j| / τ) u_iᵀ u_j    within one experiment, 0 between two,

is what a state of as many numbers as u has gives to the outputs u_iᵀ x_i, where x decays by exp(-Δt / τ) from one dwell
to the next and is driven up to unit variance again (Ornstein and Uhlenbeck). So a Kalman filter over the dwells in
their order of time whitens rows of the covariance (1 − s) I + s K, and one sum over them gives products with K. The
matrix itself, of which thousands of dwells would make a gigabyte, is never built.
"""

import numpy as np
from jaxtyping import Float


_PIECE = 256  # dwells whose whitened rows are held at a time


class AlikeDwells:
    """Dwells in their order of time, and along what each is read."""

    def __init__(
        self,
        time: Float[np.ndarray, " dwell"],
        experiment: Float[np.ndarray, " dwell"],
        output: Float[np.ndarray, "dwell 3"] | None,
    ):
        """`time` in s; `output` where a dwell has one row, along it, else `None`: three axes."""
        self.order = np.lexsort((time, experiment))
        gaps = np.diff(time[self.order], prepend=-np.inf)
        self.gaps = np.where(np.diff(experiment[self.order], prepend=np.nan) == 0.0, gaps, np.inf)
        if output is None:
            self.along = np.ones((len(time), 1))
        else:
            unit = output / np.linalg.norm(output, axis=1, keepdims=True)
            self.along = unit[self.order]

    def whitened(
        self,
        rows: Float[np.ndarray, "dwell row column"],
        shares: Float[np.ndarray, " case"],
        times: Float[np.ndarray, " case"],
    ) -> tuple[Float[np.ndarray, "case column column"], Float[np.ndarray, " case"]]:
        """XᵀT⁻¹X and log det T of X, all rows below one another, for T = (1 − s) I + s K in several cases (s, τ)."""
        count, width, columns = rows.shape
        given = rows[self.order].reshape(count, -1)
        size, cases = self.along.shape[1], len(shares)
        state = np.zeros((cases, size, given.shape[1]))
        spread = np.zeros((cases, size, size))
        gram, volume = np.zeros((cases, columns, columns)), np.zeros(cases)
        noise, identity = 1.0 - shares, np.eye(size)
        for first in range(0, count, _PIECE):
            piece = range(first, min(first + _PIECE, count))
            white = np.empty((cases, len(piece), given.shape[1]))
            variances = np.empty((cases, len(piece)))
            decays = np.exp(-self.gaps[first : first + _PIECE, None] / times)
            for k, dwell in enumerate(piece):
                decay, along = decays[k], self.along[dwell]
                state *= decay[:, None, None]
                square = np.square(decay)
                spread *= square[:, None, None]
                spread += (shares * (1.0 - square))[:, None, None] * identity
                felt = spread @ along
                variance = felt @ along + noise
                off = given[dwell] - along @ state
                gain = felt / variance[:, None]
                state += gain[:, :, None] * off[:, None, :]
                spread -= gain[:, :, None] * felt[:, None, :]
                white[:, k], variances[:, k] = off, variance
            white /= np.sqrt(variances)[:, :, None]
            volume += np.sum(np.log(variances), axis=1)
            white = white.reshape(cases, -1, columns)
            gram += white.transpose(0, 2, 1) @ white
        return gram, width * volume

    def product(
        self,
        rows: Float[np.ndarray, "dwell row column"],
        parts: Float[np.ndarray, " case"],
        times: Float[np.ndarray, " case"],
    ) -> Float[np.ndarray, "column column"]:
        """Σ part XᵀKX over the cases (part, τ)."""
        given = rows[self.order]
        count, width, columns = given.shape
        before = np.zeros((len(times), self.along.shape[1], width * columns))
        found = np.zeros((columns, columns))
        for dwell in range(count):
            # Σ of what came before, faded: K is symmetric, so that it stands for what comes after, too.
            before *= np.exp(-self.gaps[dwell] / times)[:, None, None]
            along, own = self.along[dwell], given[dwell].reshape(-1)
            earlier = np.einsum("c,m,cmq->q", parts, along, before).reshape(width, columns)
            found += given[dwell].T @ (earlier + 0.5 * np.sum(parts) * given[dwell])
            before += along[:, None] * own
        return found + found.T
