"""The five noise terms of IEEE Std 952, their units, and the Allan deviation they make together.

    σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2

All are *densities*: they do not depend on the sampling rate. What a filter or simulator asks for as
"discrete" noise is another number; `NoiseModel.discrete_sigma` and `discrete_walk` give it.
"""

import numpy as np
from jaxtyping import Float, Int

from .._records import field, Module
from .confidence import EXPONENTS


TERMS = ("Q", "N", "B", "K", "R")

FLICKER = 2.0 * np.log(2.0) / np.pi  # of B² in the Allan variance

_SHAPES = {
    "Q": lambda tau: 3.0 / tau**2,
    "N": lambda tau: 1.0 / tau,
    "B": lambda tau: np.full_like(tau, FLICKER),
    "K": lambda tau: tau / 3.0,
    "R": lambda tau: 0.5 * tau**2,
}

NAMES = {
    "accel": {
        "Q": "velocity quantisation",
        "N": "velocity random walk",
        "B": "bias instability",
        "K": "acceleration random walk",
        "R": "acceleration ramp",
    },
    "gyro": {
        "Q": "angle quantisation",
        "N": "angle random walk",
        "B": "bias instability",
        "K": "rate random walk",
        "R": "rate ramp",
    },
}

SI_UNITS = {
    "accel": {"Q": "m/s", "N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^2/sqrt(s)", "R": "m/s^3"},
    "gyro": {"Q": "rad", "N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s/sqrt(s)", "R": "rad/s^2"},
}

_G = 9.80665  # m/s², of the unit g
_DEG = float(np.rad2deg(1.0))
# Units of data sheets with what one SI unit is in them.
USUAL_UNITS = {
    "accel": {
        "Q": ("m/s", 1.0),
        "N": ("(m/s)/sqrt(h)", 60.0),
        "B": ("ug", 1e6 / _G),
        "K": ("(m/s)/h^(3/2)", 60.0**3),
        "R": ("ug/h", 3600e6 / _G),
    },
    "gyro": {
        "Q": ("arcsec", 3600.0 * _DEG),
        "N": ("deg/sqrt(h)", 60.0 * _DEG),
        "B": ("deg/h", 3600.0 * _DEG),
        "K": ("deg/h^(3/2)", 60.0**3 * _DEG),
        "R": ("deg/h^2", 3600.0**2 * _DEG),
    },
}


SAMPLE_UNITS = {"accel": ("mg", 1e3 / _G), "gyro": ("deg/s", _DEG)}  # of one sample, as above

_THROUGHOUT = 0.99  # of the Nyquist frequency: a band ends at its highest ordinate, a little below


class NoiseTerm(Module):
    """One coefficient with its 95 % interval; it has a value only where the log determines it.

    Where it does not, `value` and `std` are `None`, `lower` is zero, and `upper` is what the log proves: infinity
    where it proves nothing. A log may need one of two terms without telling which: then neither has a value, and one
    has a `least` above zero.
    """

    value: float | None  # SI, see `SI_UNITS`
    std: float | None  # of the value
    lower: float
    upper: float
    least: float = 0.0  # in the model with the fewest terms that describes the log

    @property
    def shown(self) -> bool:
        """Whether the log shows the term at all."""
        return self.value is not None

    @property
    def known(self) -> float:
        """The value, `least` where there is none: the fewest terms that describe the log."""
        return self.least if self.value is None else self.value


class NoiseModel(Module):
    """Noise of one channel as coefficients of IEEE Std 952, and how well they describe the log."""

    triad: str = field(static=True)  # "accel" or "gyro": tells the units
    rate: float = field(static=True)  # Hz, of the sensor's own samples
    duration: float = field(static=True)  # s
    terms: dict[str, NoiseTerm]
    chi2_per_dof: float  # of the spectrum in the band, in parts of octaves; far above 1: something else is there
    band: tuple[float, float]  # Hz, in which the terms were fitted; N is from here
    corner: float | None = (
        None  # Hz, where the sensor's filter has halved the power; None: not in the band
    )
    # a₁, a₂, … of the sensor's filter at `rate`, y_k = (1 + Σ a) u_k − Σ a_j y_{k−j}; empty: the log shows none
    recursion: tuple[float, ...] = ()
    rounding: float = 0.0  # the step that values are rounded to, in their unit; 0: none seen
    # One line: from which band, and where the model fails
    statement: str = field(static=True, default="")

    def deviation(self, tau: Float[np.ndarray, " tau"]) -> Float[np.ndarray, " tau"]:
        """Allan deviation that the model predicts, in the log's unit."""
        return np.sqrt(sum(self.share(name, tau) for name in TERMS))

    def share(self, name: str, tau: Float[np.ndarray, " tau"]) -> Float[np.ndarray, " tau"]:
        """One term's part of the Allan variance."""
        return self.terms[name].known ** 2 * _SHAPES[name](np.asarray(tau, float))

    def exponents(self, tau: Float[np.ndarray, " tau"]) -> Int[np.ndarray, " tau"]:
        """Exponent of the spectrum of the term that prevails at each averaging time."""
        random = list(EXPONENTS)
        largest = np.argmax([self.share(name, tau) for name in random], axis=0)
        return np.array([EXPONENTS[name] for name in random])[largest]

    @property
    def white_throughout(self) -> bool:
        """Whether the noise is white up to half the sampling rate, as that of samples which nothing averages.

        Such an N is that of this rate alone: at another one a sample scatters as much, and N goes with 1/√rate.
        """
        reaches = self.band[1] > _THROUGHOUT * 0.5 * self.rate
        return self.terms["N"].shown and self.corner is None and reaches

    @property
    def discrete_sigma(self) -> float | None:
        """Standard deviation of the white part of one sample at this rate, N √rate, m/s² or rad/s; `None` without N.

        Of a filtered log a sample scatters less than this; its mean over times longer than the filter's does not.
        """
        white = self.terms["N"].value
        return None if white is None else float(white * np.sqrt(self.rate))

    @property
    def discrete_walk(self) -> float | None:
        """Standard deviation of the random walk's step from sample to sample, K / √rate; `None` without K."""
        walk = self.terms["K"].value
        return None if walk is None else float(walk / np.sqrt(self.rate))
