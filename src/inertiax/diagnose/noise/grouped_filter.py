"""The filter of `state_space` in NumPy, by groups of rows, with the slope of its likelihood.

A campaign has a thousand rows, and one campaign is all that a process diagnoses: a compiled filter spends longer on its
compilation than on its steps, and its steps, row by row, are too small for matrix products. Here a step is a group of
`ROWS` rows. With the state $x \\sim (\\hat x, P)$ before a group, the products $A$ of the decays up to its rows, the
observation rows $H$ that see the state before the group, and the noise $R$ of the group's own, the group's innovations
have the covariance

$$S = H P H^T + R = L L^T, \\qquad V = L^{-1} (C - H \\hat x)$$

are its whitened rows, and with $M = H P\\,\\mathrm{diag}(a) + X$ between rows and the state at the group's end and
$W = L^{-1} M$

$$\\hat x' = a \\circ \\hat x + W^T V, \\qquad P' = a a^T \\circ P + \\mathrm{diag}(q) - W^T W.$$

$R$, $X$ and $q$ are linear in the variances, $H$ and $a$ do not depend on them: both are made once for a chain. The
Cholesky factor of a covariance is unique, so that the whitened rows are those of `state_space.whiten`.

**Reference:** Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter*, Cambridge 1989, ch. 3;
Murray, arXiv:1602.07527 (2016), for the derivative of a Cholesky factor, read backwards.
"""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_lapack_funcs

from ...numerics.quasi_newton import Minimum
from .processes import processes, WHITE
from .state_space import Chain, NUM_VARIANCES


ROWS = (
    32  # of a group: products large enough for BLAS, and no more noise within groups than between
)
LOST = 1e-30  # share of a state that is left, below which it is as good as none
REMEMBERED = 12  # filters of a chain; a search comes back to the noises of its bank
WIDE = (
    64  # columns whitened at once: with the rows of all groups they stay in the processor's cache
)
HALF = np.tri(ROWS) - 0.5 * np.eye(ROWS)  # the lower triangle, of which the diagonal counts half
_FACTOR, _INVERT = get_lapack_funcs(("potrf", "trtri"), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Groups:
    """What a chain's filter needs of every group of rows, for a unit of each variance."""

    num: int  # rows; those behind them up to whole groups are seen with unit variance and no state
    seen: Float[np.ndarray, "group row state"]  # H
    decay: Float[np.ndarray, "group state"]  # a
    own: Float[np.ndarray, "variance pair"]  # R, flattened, group by group
    added: Float[np.ndarray, "variance group state"]  # q
    shared: Float[np.ndarray, "variance group row state"]  # X
    known: dict[bytes, "Gains"] = field(default_factory=dict)  # the last filters, by the variances
    fitted: dict[tuple, Minimum] = field(default_factory=dict)  # searches, by all that they ask
    drawn: dict[tuple, dict[bytes, float]] = field(default_factory=dict)  # likelihoods of draws

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.decay)

    @classmethod
    def of(cls, chain: Chain) -> "Groups":
        """The groups of a chain, whose rows of padding are left out."""
        num = int(np.count_nonzero(np.asarray(chain.white) > 0.0))
        count = -(-num // ROWS)
        fold = lambda x, fill: _folded(x, count, fill)
        parts = processes(chain, num)
        size = sum(p.seen.shape[1] for p in parts)
        own = np.zeros((NUM_VARIANCES, count, ROWS, ROWS))
        seen, decay = np.zeros((count, ROWS, size)), np.zeros((count, size))
        added = np.zeros((NUM_VARIANCES, count, size))
        shared = np.zeros((NUM_VARIANCES, count, ROWS, size))
        at = 0
        for process in parts:
            here = slice(at, at + process.seen.shape[1])
            at = here.stop
            a, h = fold(process.decay, 1.0), fold(process.seen, 0.0)
            # What is lost to rounding is nothing: numbers that underflow are slow.
            between, upto = _cleared(_carried(a)), _cleared(np.cumprod(a, axis=1))
            seen[:, :, here] = h * upto[:, :, None]
            decay[:, here] = upto[:, -1, None]
            for variance, unit in process.added.items():
                level = _levels(a, fold(unit, 0.0))
                lower = between * level[:, None, :]
                both = lower + np.tril(lower, -1).transpose(0, 2, 1)
                own[variance] += both * (h @ h.transpose(0, 2, 1))
                added[variance][:, here] = level[:, -1, None]
                shared[variance][:, :, here] = h * (between[:, -1] * level)[:, :, None]
        white = fold(np.asarray(chain.white, float)[:num], 0.0)
        own[WHITE][:, range(ROWS), range(ROWS)] = white
        flat = own.reshape(NUM_VARIANCES, -1)
        return cls(num, seen, decay, flat, added, shared)


def _folded(values: np.ndarray, count: int, fill: float) -> np.ndarray:
    """Rows in groups, with `fill` behind them."""
    made = np.full((count * ROWS, *values.shape[1:]), fill)
    made[: len(values)] = values
    return made.reshape(count, ROWS, *values.shape[1:])


def _cleared(share: np.ndarray) -> np.ndarray:
    return np.where(share < LOST, 0.0, share)


def _carried(decay: Float[np.ndarray, "group row"]) -> Float[np.ndarray, "group row earlier"]:
    """What is left at a row of a state at an earlier one of its group; zeros above the diagonal."""
    made = np.zeros((*decay.shape, decay.shape[1]))
    for k in range(decay.shape[1]):
        if k:
            made[:, k] = decay[:, k, None] * made[:, k - 1]
        made[:, k, k] = 1.0
    return made


def _levels(
    decay: Float[np.ndarray, "group row"], added: Float[np.ndarray, "group row"]
) -> Float[np.ndarray, "group row"]:
    """Variance at each row of what was added since the group began."""
    made, level = np.empty_like(decay), np.zeros(len(decay))
    for k in range(decay.shape[1]):
        level = decay[:, k] ** 2 * level + added[:, k]
        made[:, k] = level
    return made


_KNOWN: dict[int, tuple[weakref.ref, Groups]] = {}


def groups_of(chain: Chain) -> Groups:
    """The groups of a chain, made once and kept as long as the chain is."""
    key = id(chain)
    if key not in _KNOWN:
        _keep(chain, Groups.of(chain))
    return _KNOWN[key][1]


def know(chain: Chain, other: Chain) -> None:
    """Make the groups of a chain from those of another one, from which it differs in its white variances alone."""
    like = groups_of(other)
    own = like.own.copy()
    white = _folded(np.asarray(chain.white, float)[: like.num], like.count, 0.0)
    own.reshape(-1, like.count, ROWS, ROWS)[WHITE][:, range(ROWS), range(ROWS)] = white
    _keep(chain, replace(like, own=own, known={}, fitted={}, drawn={}))


def _keep(chain: Chain, groups: Groups) -> None:
    key = id(chain)
    gone = weakref.ref(chain, lambda _: _KNOWN.pop(key, None))
    _KNOWN[key] = gone, groups


@dataclass(frozen=True, eq=False)
class Gains:
    """A chain's filter under given variances."""

    groups: Groups
    inverse: Float[np.ndarray, "group row row"]  # L⁻¹
    gain: Float[np.ndarray, "group row state"]  # W
    log_determinant: float

    @cached_property
    def seen(self) -> Float[np.ndarray, "group row state"]:
        """How the whitened rows see the state: $J = L^{-1} H$."""
        return self.inverse @ self.groups.seen

    @cached_property
    def carried(self) -> Float[np.ndarray, "group state state"]:
        """How the estimated state goes on: $T = \\mathrm{diag}(a) - W^T J$."""
        made = self.gain.transpose(0, 2, 1) @ -self.seen
        place = np.arange(made.shape[1])
        made[:, place, place] += self.groups.decay
        return made

    def whiten(self, columns: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
        """Whitened columns: $L^{-1} C$ with $L L^T = V$ of all rows, lower triangular."""
        made = np.empty(columns.shape)
        for first in range(0, columns.shape[1], WIDE):
            here = slice(first, first + WIDE)
            part = self._whitened(columns[:, here])
            made[:, here] = part.reshape(-1, part.shape[2])[: self.groups.num]
        return made

    def _whitened(self, columns: np.ndarray) -> Float[np.ndarray, "group row column"]:
        """Every group's rows less what the state tells of them; only the small states go from group to group."""
        own = self.inverse @ _folded(columns, self.groups.count, 0.0)
        drive = self.gain.transpose(0, 2, 1) @ own
        state = np.empty_like(drive)
        x = np.zeros(drive.shape[1:])
        for k, (carried, new) in enumerate(zip(self.carried, drive)):
            state[k] = x
            x = carried @ x + new
        own -= self.seen @ state
        return own


def gains(groups: Groups, variances: Float[np.ndarray, "7"]) -> Gains:
    """The filter of a chain under variances in the order of `Variances`, in the observations' unit squared.

    Raises `numpy.linalg.LinAlgError` where rounding leaves no positive covariance.
    """
    own = (variances @ groups.own).reshape(groups.count, ROWS, ROWS)
    short = groups.count * ROWS - groups.num
    if short:
        own[-1, range(ROWS - short, ROWS), range(ROWS - short, ROWS)] = 1.0
    added = np.tensordot(variances, groups.added, 1)
    shared = np.tensordot(variances, groups.shared, 1)
    size = groups.decay.shape[1]
    both = groups.decay[:, :, None] * groups.decay[:, None, :]
    p = np.zeros((size, size))
    spread = p.reshape(-1)[:: size + 1]  # its diagonal
    seen, told = np.empty((ROWS, size)), np.empty((size, size))
    inverses, made = np.empty_like(own), np.empty_like(groups.seen)
    steps = zip(groups.seen, groups.decay, own, shared, added, both, inverses, made)
    for k, (h, a, covariance, between, new, decay, inverse, gain) in enumerate(steps):
        hp = np.dot(h, p, out=seen)
        covariance += np.dot(hp, h.T)
        # SciPy takes columns first: the transpose of a symmetric matrix is itself.
        factor, failed = _FACTOR(covariance.T, lower=1, overwrite_a=1)
        if failed:
            raise np.linalg.LinAlgError(f"group {k}: no positive covariance")
        inverse[:] = _INVERT(factor, lower=1, overwrite_c=1)[0]
        hp *= a
        hp += between
        np.dot(inverse, hp, out=gain)
        p *= decay
        p -= np.dot(gain.T, gain, out=told)
        spread += new
    logs = float(np.log(np.einsum("kii->ki", inverses)).sum())
    if not np.isfinite(logs):
        raise np.linalg.LinAlgError("variances too large to compute with")
    return Gains(groups, inverses, made, -2.0 * logs)


def whiten(
    chain: Chain, variances: Float[np.ndarray, "7"], columns: Float[np.ndarray, "row column"]
) -> tuple[Float[np.ndarray, "row column"], float]:
    """`state_space.whiten` in this form.

    Raises `numpy.linalg.LinAlgError` where rounding leaves no positive covariance.
    """
    found = filter_of(groups_of(chain), variances)
    return found.whiten(columns), found.log_determinant


def filter_of(groups: Groups, variances: Float[np.ndarray, "7"]) -> Gains:
    """`gains`, of which the last few of a chain are kept."""
    found = groups.known.get(variances.tobytes())
    return remember(variances, gains(groups, variances) if found is None else found)


def remember(variances: Float[np.ndarray, "7"], found: Gains) -> Gains:
    """Keep a filter for the next one that asks for these variances."""
    known, key = found.groups.known, variances.tobytes()
    known.pop(key, None)
    while len(known) >= REMEMBERED:
        known.pop(next(iter(known)))
    known[key] = found  # the latest one stands last
    return found


def gradient(
    found: Gains,
    columns: Float[np.ndarray, "row column"],
    by_gram: Callable[
        [Float[np.ndarray, "column column"]], tuple[float, Float[np.ndarray, "column column"]]
    ],
) -> tuple[float, Float[np.ndarray, "7"]]:
    """Half the log determinant and a function of $G = V^T V$ of the whitened columns, with the slope by the variances.

    `by_gram(G)` gives the function and its symmetric derivative by G. The steps of the filter are gone through
    backwards, with bars for derivatives by what stands below them,

    $$\\bar V = 2 V \\bar G + W \\bar{x}', \\quad \\bar W = V \\bar{x}'^T - 2 W \\bar P', \\quad
    \\bar C = L^{-T} \\bar V, \\quad \\bar M = L^{-T} \\bar W, \\quad
    \\bar S = \\tfrac12 L^{-T}\\,\\mathrm{mirrored}(1 - \\bar V V^T - \\bar W W^T)\\, L^{-1},$$

    where `mirrored` takes the lower triangle for both. What of the bars before a group comes from those behind it is
    $T^T \\bar x'$ and $T^T \\bar P' T$ with $T = \\mathrm{diag}(a) - W^T L^{-1} H$; the rest is made for all groups
    at once.
    """
    groups = found.groups
    white = found._whitened(columns)
    flat = white.reshape(-1, white.shape[2])
    value, by = by_gram(flat.T @ flat)
    pulled = (flat @ (2.0 * by)).reshape(white.shape)
    inverse, gain, seen, a = found.inverse, found.gain, found.seen, groups.decay
    turned = lambda x: x.transpose(0, 2, 1)
    x = _gone_back(found, turned(seen) @ pulled)
    pulled += gain @ x  # the bar of V
    w_bar = white @ turned(x)
    by_rows = np.concatenate([pulled, w_bar], axis=2)
    by_gain = np.concatenate([white, gain], axis=2)
    inner = by_rows @ turned(by_gain)
    np.subtract(np.eye(ROWS), inner, out=inner)
    inner *= HALF
    added = turned(seen) @ inner @ seen + turned(seen) @ w_bar * a[:, None, :]
    p = _covariances_back(found, 0.5 * (added + turned(added)))
    behind = 2.0 * (gain @ p)
    w_bar -= behind
    later = behind @ turned(gain)
    later *= HALF
    inner += later
    # To be multiplied by symmetric matrices: needs no mirroring
    by_own = turned(inverse) @ inner @ inverse
    by_shared = turned(inverse) @ w_bar
    by_added = np.einsum("kss->ks", p)
    slope = groups.own @ by_own.reshape(-1)
    slope += np.tensordot(groups.added, by_added, 2) + np.tensordot(groups.shared, by_shared, 3)
    return 0.5 * found.log_determinant + value, slope


def _gone_back(
    found: Gains, seen: Float[np.ndarray, "group state column"]
) -> Float[np.ndarray, "group state column"]:
    """Bars of the estimated states behind each group, from what each group sees of the bar of its whitened rows."""
    made = np.empty_like(seen)
    x = np.zeros(seen.shape[1:])
    for carried, behind, own in zip(found.carried[::-1], made[::-1], seen[::-1]):
        behind[:] = x
        x = np.dot(carried.T, x)
        x -= own
    return made


def _covariances_back(
    found: Gains, added: Float[np.ndarray, "group state state"]
) -> Float[np.ndarray, "group state state"]:
    """Bars of the states' covariances behind each group, from what each group adds."""
    made = np.empty_like(added)
    p = np.zeros(added.shape[1:])
    for carried, behind, own in zip(found.carried[::-1], made[::-1], added[::-1]):
        behind[:] = p
        p = np.dot(np.dot(carried.T, p), carried)
        p += own
    return made
