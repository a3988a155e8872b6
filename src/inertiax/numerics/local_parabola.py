"""Values and slopes along evenly spaced samples by parabolas through the samples about each."""

import numpy as np
from jaxtyping import Float


DIRECT = 1e7  # products from which the sums are made by a Fourier transform


def local_parabola(
    values: Float[np.ndarray, " sample"], width: int, step: float | None = None
) -> Float[np.ndarray, " sample"]:
    """The smoothed value at each sample, or with a `step` between samples the slope, in the values' unit per its unit.

    Over an odd `width` of samples, of which there are as many at least, a parabola is fitted by least squares and taken
    in its middle; within half a width of the ends that of the first or last samples is.

    **Reference:** Savitzky and Golay, Analytical Chemistry 36 (1964) 1627; `scipy.signal.savgol_filter` does the same,
    and takes as long to import as all that a diagnosis needs of SciPy.
    """
    half = width // 2
    place = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.stack([np.ones(width), place, place**2]).T)
    order = 0 if step is None else 1
    offset = float(np.mean(values))
    values = np.asarray(values) - offset
    made = np.empty(len(values))
    made[half : len(made) - half] = _products(values, fit[order])
    for part, here in ((values[:width], place[:half]), (values[-width:], place[half + 1 :])):
        _, slope, bend = fit @ part
        at = (
            (fit[0] @ part + (slope + bend * here) * here)
            if order == 0
            else slope + 2.0 * bend * here
        )
        made[slice(0, half) if here[0] < 0 else slice(len(made) - half, None)] = at
    return made + offset if step is None else made / step


def _products(
    values: Float[np.ndarray, " sample"], weights: Float[np.ndarray, " weight"]
) -> Float[np.ndarray, " inner"]:
    """Sums of `values[k : k + width] * weights` for each k."""
    if len(values) * len(weights) < DIRECT:
        return np.convolve(values, weights[::-1], mode="valid")
    size = 1 << (len(values) - 1).bit_length()
    turned = np.fft.rfft(values, size) * np.conj(np.fft.rfft(weights, size))
    return np.fft.irfft(turned, size)[: len(values) - len(weights) + 1]
