"""How alike the slow noise of a triad's channels is in other people's recordings.

    INERTIAX_RECORDINGS=… python benchmarks/triad_noise.py

The diagnosis expects of one channel of a triad the noise that the two others show
(`inertiax.diagnose.noise.pooled_channels`), for a weak effect is then seen better (`blind/learned.py`, with and
without `--alone`). Is that so of real sensors? Gyros at rest of three MPU-9150 logs and of an Xsens MTi, with a bias
as the model and, on the Xsens, its g-sensitivity taken out. Each channel's own variances by restricted maximum
likelihood stand beside one set for all three; twice the difference in log likelihood is the evidence against it, with
one degree of freedom for each component that two more channels have of their own (flicker, walk, dwells: six; the
white noise stays each channel's own).
"""

import jax
import numpy as np
import scipy.optimize
import scipy.stats
from real_recordings import mpu, xsens

from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.noise.observation_series import BOUNDS, NoiseFit, System, variances
from inertiax.diagnose.noise.reml import fit_noise, likelihood
from inertiax.diagnose.problem import prepare


SHARED = [1, 2, 3]  # flicker, walk, dwells
KINDS = ("flicker", "walk", "dwell")


def one_for_all(system: System, own: NoiseFit, chosen: list[Term]) -> NoiseFit:
    """Variances that are the same on all chains but for the white noise, nearest to the rows."""
    scales = np.log(system.scales)[:, SHARED]
    starts = [own.theta[c][SHARED] + scales[c] for c in range(3)]

    def spread(shared: np.ndarray) -> tuple[np.ndarray, ...]:
        made = [theta.copy() for theta in own.theta]
        low, high = np.transpose(BOUNDS)[:, SHARED]
        for c, theta in enumerate(made):
            theta[SHARED] = np.clip(shared - scales[c], low, high)
        return tuple(made)

    def cost(shared: np.ndarray) -> float:
        noise = NoiseFit(spread(shared), own.value)
        return sum(likelihood(system, noise, chosen, c) for c in range(3))

    found = [scipy.optimize.minimize(cost, s, method="Nelder-Mead") for s in starts]
    best = min(found, key=lambda f: f.fun)
    return NoiseFit(spread(best.x), (float(best.fun), 0.0, 0.0))


def main() -> None:
    """Print each triad's noise and the evidence that its channels differ."""
    campaigns = {f"MPU-9150 {k}": mpu(k) for k in range(3)} | {"Xsens MTi": xsens()}
    for title, campaign in campaigns.items():
        triads = prepare(campaign).triads
        gyro = next(p for p in triads if p.form.triad == "gyro")
        sensitive = title.startswith("Xsens")
        chosen = [t for t in gyro.candidates if sensitive and t.name == "g_sensitivity"]
        own = fit_noise(gyro.system, chosen)
        fits = [likelihood(gyro.system, own, chosen, c) for c in range(3)]
        shared = one_for_all(gyro.system, own, chosen)
        # Where nothing but white noise is left, the separate fits stop up to 0.1 short of their shared one.
        ratio = max(2.0 * (shared.total - sum(fits)), 0.0)
        print(
            f"\n{title}: twice the log likelihood ratio {ratio:.1f} against equal noise "
            f"(chance {scipy.stats.chi2.sf(ratio, 2 * len(SHARED)):.1g})"
        )
        for axis, levels in zip("xyz", variances(gyro.system, own)):
            said = ", ".join(f"{kind} {np.sqrt(getattr(levels, kind)):.2g}" for kind in KINDS)
            print(f"  gyro_{axis}: {said} (rad/s; walk per √s)")


if __name__ == "__main__":
    with jax.enable_x64(True):
        main()
