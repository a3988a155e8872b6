"""What dwells and recordings still differ by where nothing more is named: said, since a diagnosis takes it as noise."""

import math

import numpy as np

from ...calibrate.goodness_of_fit import LIMITS
from ...calibrate.level_by_recording import level_words
from ...calibrate.results import DeviceResult
from ...calibration.quantities import rms_text
from ..noise.observation_series import NoiseFit, System, variances
from ..noise.state_space import Chain, TIME_CONSTANTS, Variances
from ..observations.blocks import Blocks


TRIADS = {"accel": "accelerometers", "gyro": "gyros"}
_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
_FEWEST = 3  # dwells that tell their scatter


def scatter_sentence(result: DeviceResult) -> str:
    """One sentence for each triad whose recordings' biases differ, as `calibrate` says it, or whose dwells differ by
    far more than their noise, by its limit.

    **Arguments:** the calibration that is written, beside named effects if there are any.
    """
    said = []
    levels = level_words(result, float(result.calibration.gravity))
    for triad, name in TRIADS.items():
        estimate = getattr(result, triad)
        if estimate is None:
            continue
        if triad in levels:
            said.append(f"Taken as noise: {levels[triad]}.")
            continue
        ratio = math.sqrt(estimate.chi2_per_dof)
        if ratio >= LIMITS.noise_ratio:  # not where the noise is unknown
            left = rms_text(estimate.misfit_unit, estimate.rms)
            said.append(_taken_for_scatter(f"The {name}' dwells", left, ratio))
    return " ".join(said)


def model_scatter_sentence(system: System, blocks: Blocks, noise: NoiseFit) -> str:
    r"""The same of a user's own model, of which no calibration tells a misfit; empty where there is none to tell.

    A channel is named where the scatter between dwells that the rows were judged with, τ, is from

    $$\sqrt{\tau^2 + s^2} \geq 3 s$$

    on, with $s^2$ the mean over dwells of what white noise, flicker and random walk leave in a dwell's mean.

    **Arguments:** `noise` beside the effects that were named.
    """
    triad = system.base.form.triad
    if len(np.unique(blocks.dwell)) < _FEWEST:
        return ""
    several = zip("xyz", system.chains, variances(system, noise), strict=True)
    ratios = {axis: (v.dwell, _noise_of_means(chain, blocks, v)) for axis, chain, v in several}
    apart = {
        axis: (scatter, math.sqrt(1.0 + scatter / own))
        for axis, (scatter, own) in ratios.items()
        if scatter >= (LIMITS.noise_ratio**2 - 1.0) * own > 0.0
    }
    if not apart:
        return ""
    rms = math.sqrt(np.mean([scatter for scatter, _ in apart.values()]))
    channels = ", ".join(f"{triad}_{axis}" for axis in apart)
    return _taken_for_scatter(
        f"The dwells of {channels}",
        rms_text(_UNITS[triad], rms),
        max(ratio for _, ratio in apart.values()),
    )


def _noise_of_means(chain: Chain, blocks: Blocks, part: Variances) -> float:
    """Mean over dwells of the variance of a dwell's mean by noise; slow noise as if it were constant in a dwell."""
    total = []
    for dwell in np.unique(blocks.dwell):
        rows = blocks.dwell == dwell
        white = part.white * np.sum(chain.white[rows]) / np.count_nonzero(rows) ** 2
        length = float(np.ptp(blocks.time[rows]))
        total.append(white + len(TIME_CONSTANTS) * part.flicker + part.walk * length)
    return float(np.mean(total))


def _taken_for_scatter(dwells: str, left: str, ratio: float) -> str:
    return (
        f"{dwells} still differ by {left} rms, {ratio:.1f} times their noise, in a way that nothing catalogued "
        "follows: it counts as scatter, drawn anew for each dwell, and its cause is not known."
    )
