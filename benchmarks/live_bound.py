"""How few rests could do by hand: what an oracle needs that knows each device's noise, against the best fixed plan.

Persons, devices and target are those of `live_hand.py`. A plan is a share of faces, edges and corners up; n rests of it
on a device of variance σ² a rest leave a covariance C σ² / n, C by the derivatives (uᵢ, g uᵢ uⱼ) of gravity's magnitude
averaged over how the person follows. n is any real number, and all n rests are made of the best shares: no order, no
rounding and nothing to be learned, so that these are bounds and not designs. Rests that are refused count.

* The plan: n for all, so that 95 % of the devices have all errors within their limits.
* The oracle knows σ² of its device and takes the n after which its errors are within with 95 %; at least nine rests, or
  the 14 that `live` waits for so that a batch estimate has five degrees of freedom.
* The oracle that averages spends the 5 % on the noisiest devices instead: it gives up on them. A statement of 95 % on
  each device is not its.
* The oracle of rest lengths chooses how long a device rests, too, by its noise (which falls with the length) and its
  scatter (which does not), for the least seconds; the plan has the best one length for all.

    python benchmarks/live_bound.py [--devices 20000]
"""

import argparse
import itertools

import live_hand as hand
import numpy as np


SHARE = 0.95
DRAWS = 100_000
MADE = 1.0 - hand.REFUSED
USED = 4.0  # s, of a rest whose noise is `hand.NOISE`
TURN = 4.0  # s, of a turn (convention)


def information(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """Of a rest in one of these directions as a person holds them, for a variance of 1."""
    told = directions[rng.integers(len(directions), size=DRAWS // 5)]
    up = np.array([hand.held(rng, one) for one in told])
    rows, columns = np.tril_indices(3)
    row = np.concatenate([-up, -hand.GRAVITY * up[:, rows] * up[:, columns]], axis=1)
    return row.T @ row / len(row)


class Errors:
    """Errors of a plan: the greatest one relative to its limit, for a variance of 1 a rest and one rest."""

    def __init__(self, information: np.ndarray, normal: np.ndarray):
        limits = hand.limits()
        asked = np.isfinite(limits)
        covariance = np.linalg.inv(information)[np.ix_(asked, asked)]
        errors = np.abs(normal @ np.linalg.cholesky(covariance).T) / limits[asked]
        self.greatest = np.sort(errors.max(axis=1))

    def within(self, rests: np.ndarray | float, variance: np.ndarray) -> np.ndarray:
        """Probability that all errors are within their limits."""
        return np.searchsorted(self.greatest, np.sqrt(rests / variance)) / len(self.greatest)

    @property
    def needed(self) -> float:
        """Rests for a variance of 1 after which that is 95 %."""
        return float(np.quantile(self.greatest, SHARE) ** 2)

    def planned(self, variance: np.ndarray) -> float:
        """Rests for all devices, so that 95 % of them are within."""
        low, high = 1.0, 2000.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            enough = np.mean(self.within(middle, variance)) >= SHARE
            low, high = (low, middle) if enough else (middle, high)
        return high

    def averaged(self, variance: np.ndarray, fewest: int) -> float:
        """Mean rests of an oracle that is within on 95 % of all devices, at the least cost."""
        counts = np.arange(fewest, 400)
        within = self.within(counts[None, :], variance[:, None])
        low, high = 1e-7, 1.0
        for _ in range(40):  # the price of a rest in probability
            price = np.sqrt(low * high)
            chosen = np.argmax(within - price * counts, axis=1)
            enough = np.mean(within[np.arange(len(variance)), chosen]) >= SHARE
            low, high = (price, high) if enough else (low, price)
        return float(np.mean(counts[chosen]))


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=20_000)
    asked = parser.parse_args()
    rng = np.random.default_rng(0)
    cube = hand.plans(rng)["26 of the cube"]
    classes = [information(rng, d) for d in (cube[:6], cube[6:18], cube[18:])]
    normal = rng.standard_normal((DRAWS, 6))
    errors = lambda shares: Errors(np.tensordot(shares, classes, 1), normal)
    grid = np.arange(0.0, 1.001, 0.05)
    shares = [(f, e, 1.0 - f - e) for f, e in itertools.product(grid[1:], grid) if f + e < 1.0001]
    usable = [s for s in shares if s[0] < 0.99]  # faces alone do not tell the rest of the matrix
    best = min(usable, key=lambda s: errors(s).needed)
    found = errors(best)
    print(f"the best plan: faces {best[0]:.2f}, edges {best[1]:.2f}, corners {best[2]:.2f}")

    spread = lambda usual: usual * np.exp(hand.SPREAD * rng.standard_normal(asked.devices))
    noise, scatter = spread(hand.NOISE), spread(hand.SCATTER)
    variance = noise**2 + scatter**2
    plan = found.planned(variance) / MADE
    print(
        f"its rests: {plan:.1f}; of faces and edges alike {errors((1 / 3, 2 / 3, 0.0)).planned(variance) / MADE:.1f}"
    )
    for fewest in (9, 14):
        oracle = np.mean(np.maximum(found.needed * variance, fewest)) / MADE
        average = found.averaged(variance[:4000], fewest) / MADE
        print(
            f"oracle, {fewest} rests or more: {oracle:.1f}, ratio {oracle / plan:.2f}; "
            f"on average of all devices: {average:.1f}, ratio {average / plan:.2f}"
        )

    lengths = np.geomspace(1.0, 64.0, 37)
    total = lambda length, n: (TURN + length) * n / MADE
    of = lambda length: noise**2 * USED / length + scatter**2
    planned = min(total(t, max(found.planned(of(t)), 9)) for t in lengths)
    each = np.array([total(t, np.maximum(found.needed * of(t), 9)) for t in lengths])
    usual = np.mean(total(USED, np.maximum(found.needed * variance, 9)))
    print(
        f"seconds with {TURN:.0f} s a turn: plan {planned:.0f}, oracle {usual:.0f} (ratio {usual / planned:.2f}), "
        f"oracle of rest lengths {np.mean(each.min(axis=0)):.0f} (ratio {np.mean(each.min(axis=0)) / planned:.2f})"
    )


if __name__ == "__main__":
    main()
