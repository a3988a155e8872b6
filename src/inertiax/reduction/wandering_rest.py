"""How far a bias wanders within the one rest of a log, where no other rest tells it.

Samples within a rest tell the noise of its mean up to averages of a tenth of it (`mean_noise`); a slope drops out of
these, and a slow walk looks like one. Where there are several rests, their means differ by it. Of one rest the means of
equal parts remain, whose covariance over the parts' own variance σ² is

    I + κ G + R² t tᵀ

with t the parts' time over the rest's length L, and G of a random walk or of flicker noise. κ and R are averaged over
what the parts say of them, and so is whether an axis has any. A rest of length L stands for stretches as long,
which differ by the Allan variance at L:

    AVAR(L) = σ² / 16 + κ σ² + R² σ² / 2     white noise (the mean's own variance), G with AVAR(L) = 1, ramp

**Reference:** IEEE Std 952-1997, annex C (Allan variances of random walk, flicker noise and ramp).
"""

import numpy as np
from jaxtyping import Float

from .mean_noise import quantisation_step


PARTS = 16  # of the rest: a walk's variance from as many is known to a third, and each is long beside a sample
_FEWEST = 16  # samples of a part, whose mean is normal
# Probability of slow noise from which it counts, four to one: white noise reaches it in 1 % of logs, in which "±" is
# then several times as wide. Slow noise below ten times the mean's own variance is often missed: deviates of up to 2.
_LIKELY = 0.8
_SHARED = 0.75  # of the axes of a triad with slow noise, those that have it (convention)
_HUGE = 200.0  # log of a ratio, whose third power a double holds
_LEAST = 0.5  # of the mean's own variance, the smallest that is tried: less adds little to "±"
_MOST = 10.0  # times the variance that the parts show, the greatest that is tried
_TRIED = 12  # sizes of each, a factor of 2 to 4 apart


def wander_of_rest(
    samples: Float[np.ndarray, "time axis"], variance: Float[np.ndarray, " axis"]
) -> Float[np.ndarray, " axis"]:
    """Variance, unit², that slow noise adds to `variance`, that of the mean by the scatter of the samples.

    Zero where slow noise of the triad is less likely than none, on axes that are constant, and for fewer samples than
    tell. The axes decide together: what makes one wander, warming up or flicker, rarely leaves the others alone, and a
    slope that one of three has by chance would make its "±" several times as wide.

    ```python
    import numpy as np
    from inertiax.reduction.wandering_rest import wander_of_rest

    ramp = np.linspace(-1.0, 1.0, 16_000)[:, None] + 0.1 * np.random.default_rng(0).normal(size=(16_000, 1))
    print(wander_of_rest(ramp, np.array([0.1**2 / 16_000])))    # R² L² / 2 = 2
    ```
    """
    found = np.zeros(samples.shape[1])
    if len(samples) < PARTS * _FEWEST:
        return found
    edges = np.linspace(0, len(samples), PARTS + 1).astype(int)
    parts = np.add.reduceat(samples, edges[:-1], axis=0) / np.diff(edges)[:, None]
    odds = 1.0
    for axis in range(samples.shape[1]):
        # What rounding leaves of the mean of a part is the same in all parts of a constant, and no walk.
        own = max(PARTS * float(variance[axis]), (1e-3 * quantisation_step(samples[:, axis])) ** 2)
        if own > 0.0:
            gain, slow = _slow_part(parts[:, axis] / np.sqrt(own))
            of_axis = 1.0 - _SHARED + _SHARED * gain
            found[axis] = own * slow * _SHARED * gain / of_axis
            odds *= of_axis
    return found if odds > _LIKELY / (1.0 - _LIKELY) else np.zeros_like(found)


def _slow_part(parts: Float[np.ndarray, " part"]) -> tuple[float, float]:
    """How many times likelier slow noise makes parts, in units of their own standard deviation, than white noise, and
    its Allan variance at the rest's length, the mean over what it may be."""
    # The mean is what is estimated: orthonormal contrasts to it tell the rest.
    contrasts = np.linalg.svd(np.ones((1, PARTS)))[2][1:]
    y = contrasts @ parts
    t = contrasts @ (np.arange(PARTS) / PARTS)
    most = _MOST * max(float(y @ y) / (PARTS - 1), 1.0)
    sizes = np.geomspace(_LEAST / PARTS, most, _TRIED)  # as Allan variances of the whole rest
    ramps = np.append(0.0, 2.0 * sizes)
    cases = [(_WALK, 0.0)] + [(kernel, size) for kernel in (_WALK, _FLICKER) for size in sizes]
    fit, slow = np.empty((len(cases), len(ramps))), np.empty((len(cases), len(ramps)))
    for k, (kernel, size) in enumerate(cases):
        covariance = np.eye(PARTS - 1) + size * (contrasts @ kernel @ contrasts.T)
        solved = np.linalg.solve(covariance, np.column_stack([y, t]))
        along, of_time = t @ solved[:, 0], t @ solved[:, 1]
        left = ramps / (1.0 + ramps * of_time)  # variance of R beside the parts
        spread = np.linalg.slogdet(covariance)[1] + np.log1p(ramps * of_time)
        fit[k] = -0.5 * (spread + y @ solved[:, 0] - left * along**2)
        slow[k] = size + 0.5 * (np.square(left * along) + left)
    # Noise alone, a ramp alone and both are alike likely, and so are sizes.
    prior = np.full(fit.shape, 1.0 / (6 * _TRIED * _TRIED))
    prior[0, 1:], prior[1:, 0], prior[0, 0] = 1.0 / (3 * _TRIED), 1.0 / (6 * _TRIED), 0.0
    weight = prior * np.exp(fit - fit.max())
    gain = float(np.exp(min(np.log(weight.sum()) + fit.max() - fit[0, 0], _HUGE)))
    return gain, float(np.sum(weight * slow) / weight.sum())


def _kernels() -> tuple[Float[np.ndarray, "part part"], Float[np.ndarray, "part part"]]:
    """Covariance of the parts' means, but for a constant, by a random walk and by flicker noise whose Allan variance
    at the length of the rest is one."""
    number = np.arange(PARTS)
    walk = np.minimum.outer(number, number) + 0.5 - np.eye(PARTS) / 6.0  # 1/3 on the diagonal
    lag = np.abs(number[:, None] - number) + np.array([-1.0, 0.0, 1.0])[:, None, None]
    # −ln|t − s| over two parts: the second difference of its second integral. Its Allan variance is 2 ln 2 throughout.
    twice = 0.5 * np.square(lag) * np.log(
        np.where(lag == 0.0, 1.0, np.abs(lag))
    ) - 0.75 * np.square(lag)
    return 3.0 / PARTS * walk, -(twice[0] - 2.0 * twice[1] + twice[2]) / (2.0 * np.log(2.0))


_WALK, _FLICKER = _kernels()
