"""The device and its surroundings: heat, friction, noise, converters, rig errors.

Written on its own terms (a thermal network, stacks of play elements, sums of relaxation
processes), so that what the diagnosis knows as a formula arises here from a mechanism.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.signal import lfilter
from table import Plan


EARTH_RATE = 7.292115e-5  # rad/s
ARCSEC = np.pi / 180 / 3600


@dataclass(frozen=True)
class Grade:
    """Noise and rig of one class of device; 1 sigma, SI. From field knowledge, not checked."""

    white: dict  # of one sample at 4 Hz
    flicker: dict  # of one relaxation process (there are five, a decade and a half apart)
    walk: dict  # per sqrt(s)
    dwell: dict  # offset new at each dwell
    session: dict  # offset new at each power-on
    step: dict  # converter
    slope: dict  # of the bias, per °C
    scale: dict  # slope of the scale factor, per °C
    matrix: dict  # size of constant scale and misalignment errors
    bias: dict
    position: float  # arcsec
    rate: float  # ppm
    temperature: float  # °C


GRADES = {
    "navigation": Grade(
        white=dict(accel=1.8e-4, gyro=1.6e-6), flicker=dict(accel=1.2e-5, gyro=3e-8),
        walk=dict(accel=1.5e-7, gyro=3e-10), dwell=dict(accel=4e-5, gyro=6e-8),
        session=dict(accel=3e-5, gyro=4e-8), step=dict(accel=1e-6, gyro=5e-8),
        slope=dict(accel=3e-4, gyro=1.5e-8), scale=dict(accel=6e-5, gyro=1e-5),
        matrix=dict(accel=1e-3, gyro=5e-4), bias=dict(accel=2e-2, gyro=5e-7),
        position=2.0, rate=5.0, temperature=0.05,
    ),
    "tactical": Grade(
        white=dict(accel=7e-4, gyro=3e-5), flicker=dict(accel=8e-5, gyro=1.5e-6),
        walk=dict(accel=1e-6, gyro=1.5e-8), dwell=dict(accel=2e-4, gyro=4e-6),
        session=dict(accel=1.5e-4, gyro=3e-6), step=dict(accel=2e-5, gyro=1e-6),
        slope=dict(accel=3e-3, gyro=3e-6), scale=dict(accel=1e-4, gyro=5e-5),
        matrix=dict(accel=2e-3, gyro=1e-3), bias=dict(accel=5e-2, gyro=1e-4),
        position=10.0, rate=20.0, temperature=0.1,
    ),
    "consumer": Grade(
        white=dict(accel=3e-3, gyro=2.6e-4), flicker=dict(accel=5e-4, gyro=3e-5),
        walk=dict(accel=6e-6, gyro=3e-7), dwell=dict(accel=1e-3, gyro=5e-5),
        session=dict(accel=8e-4, gyro=5e-5), step=dict(accel=4.9e-4, gyro=6.1e-5),
        slope=dict(accel=1.2e-2, gyro=2e-4), scale=dict(accel=2.5e-4, gyro=2.5e-4),
        matrix=dict(accel=1.5e-2, gyro=1e-2), bias=dict(accel=0.25, gyro=5e-3),
        position=60.0, rate=100.0, temperature=0.2,
    ),
}  # fmt: skip

RELAXATIONS = np.array([20.0, 110.0, 600.0, 3300.0, 18000.0])  # s, time constants of the flicker


def relax(values: np.ndarray, dt: np.ndarray, tau: float, start: float | None = None) -> np.ndarray:
    """First-order node: tau dy/dt = x - y, exact for inputs held over each step."""
    out = np.empty_like(values)
    y = values[0] if start is None else start
    keep = np.exp(-dt / tau)
    for i, x in enumerate(values):
        y = x + (y - x) * keep[i]
        out[i] = y
    return out


def steps_of(plan: Plan) -> np.ndarray:
    """Seconds since the sample before; the first sample counts one sampling time."""
    dt = np.diff(plan.time)
    return np.concatenate([[np.median(dt)], dt])


@dataclass
class Heat:
    """Temperatures (°C) along the plan."""

    case: np.ndarray  # where the probe sits
    probe: np.ndarray  # what the probe says, its own error and converter included
    since_power: np.ndarray  # s


def heat(plan: Plan, grade: Grade, rng, case_tau: float) -> Heat:
    """Air to case node, a little self-heating from power-on, and a probe that is not perfect.

    The probe's error stays within the station's promise: a relaxation process over 1500 s and an
    offset per session, together 0.5 of the stated standard deviation.
    """
    dt = steps_of(plan)
    case = np.empty_like(plan.time)
    since = np.empty_like(plan.time)
    own = float(rng.uniform(0.3, 1.2))
    for s in np.unique(plan.session):
        rows = plan.session == s
        since[rows] = plan.time[rows] - plan.time[rows][0]
        air = plan.chamber[rows]
        warm = own * (1 - np.exp(-since[rows] / 420.0))
        case[rows] = relax(air, dt[rows], case_tau) + warm
    error = probe_error(plan, grade, rng)
    probe = np.round((case + error) / 2**-9) * 2**-9
    return Heat(case=case, probe=probe, since_power=since)


PROBE_TAU, PROBE_SHARE = 1500.0, 0.5


def probe_error(plan: Plan, grade: Grade, rng) -> np.ndarray:
    """°C; half its variance wanders over 1500 s, half is new at each power-on."""
    each = PROBE_SHARE * grade.temperature / np.sqrt(2)
    wander = ornstein_uhlenbeck(plan.time, PROBE_TAU, each, rng)
    offsets = each * rng.standard_normal(int(plan.session.max()) + 1)
    return wander + offsets[plan.session]


def ornstein_uhlenbeck(time, tau, sigma, rng) -> np.ndarray:
    """Stationary relaxation process of standard deviation `sigma`, exact at any sampling."""
    keep = np.exp(-np.diff(time, prepend=time[0]) / tau)
    kick = sigma * np.sqrt(1 - keep**2) * rng.standard_normal(len(time))
    kick[0] = sigma * rng.standard_normal()
    usual = np.median(keep)
    if np.allclose(keep[1:], usual):
        return np.asarray(lfilter([1.0], [1.0, -usual], kick))
    out, y = np.empty(len(time)), 0.0
    for i in range(len(time)):
        y = keep[i] * y + kick[i]
        out[i] = y
    return out


CHANNEL_SCATTER = (
    0.15  # of the logarithm of a noise's standard deviation, between a triad's channels
)


@dataclass
class Noise:
    """Standard deviations of one triad in one case (SI); what `covariance.py` is built from."""

    white: float
    flicker: np.ndarray  # channel by channel, (3,), as the next three
    walk: np.ndarray
    dwell: np.ndarray
    session: np.ndarray
    step: float
    position: float  # rad
    rate: float  # relative

    @staticmethod
    def of(grade: Grade, triad: str, fs: float, level: dict, rng) -> "Noise":
        """The channels of a triad are alike and not equal."""
        own = np.exp(CHANNEL_SCATTER * rng.standard_normal((4, 3)))
        return Noise(
            white=grade.white[triad] * np.sqrt(fs / 4.0),
            flicker=grade.flicker[triad] * level["flicker"] * own[0],
            walk=grade.walk[triad] * level["walk"] * own[1],
            dwell=grade.dwell[triad] * level["dwell"] * own[2],
            session=grade.session[triad] * level["session"] * own[3],
            step=grade.step[triad],
            position=grade.position * ARCSEC * level["rig"],
            rate=grade.rate * 1e-6 * level["rig"],
        )


def sensor_noise(plan: Plan, noise: Noise, rng) -> np.ndarray:
    """(n, 3): white, flicker, random walk (from zero at each power-on), dwell and session offsets."""
    n = len(plan.time)
    out = noise.white * rng.standard_normal((n, 3))
    dt = steps_of(plan)
    for c in range(3):
        for tau in RELAXATIONS:
            out[:, c] += ornstein_uhlenbeck(plan.time, tau, noise.flicker[c], rng)
        walk = noise.walk[c] * np.sqrt(dt) * rng.standard_normal(n)
        for s in np.unique(plan.session):
            rows = plan.session == s
            out[rows, c] += np.cumsum(walk[rows])
    per_dwell = noise.dwell * rng.standard_normal((int(plan.dwell.max()) + 2, 3))
    per_session = noise.session * rng.standard_normal((int(plan.session.max()) + 1, 3))
    return out + per_dwell[plan.dwell] + per_session[plan.session]


def rig_errors(plan: Plan, noise: Noise, rng) -> tuple[np.ndarray, np.ndarray]:
    """Small rotation (n, 3) rad of the case, new at each move, and relative rate error (n,)."""
    start = np.concatenate([[True], (np.diff(plan.dwell) != 0) & (plan.dwell[1:] >= 0)])
    index = np.cumsum(start) - 1
    turns = noise.position * rng.standard_normal((index[-1] + 1, 3))
    rates = noise.rate * rng.standard_normal(index[-1] + 1)
    return turns[index], rates[index]


def earth(plan: Plan, latitude: float) -> np.ndarray:
    """(n, 3) Earth rate in case axes, rad/s."""
    phi = np.deg2rad(latitude)
    return EARTH_RATE * (np.cos(phi) * plan.north + np.sin(phi) * plan.up)


@dataclass
class Sensor:
    """Bias and matrix of one triad as Chebyshev series of the case temperature."""

    low: float
    high: float
    bias: np.ndarray  # (degree + 1, 3)
    matrix: np.ndarray  # (degree + 1, 3, 3)

    def scaled(self, temperature):
        return (2 * temperature - self.low - self.high) / (self.high - self.low)

    def bias_at(self, temperature) -> np.ndarray:
        return chebyshev.chebvander(self.scaled(temperature), len(self.bias) - 1) @ self.bias

    def matrix_at(self, temperature) -> np.ndarray:
        basis = chebyshev.chebvander(self.scaled(temperature), len(self.bias) - 1)
        return np.einsum("nk,kij->nij", basis, self.matrix)

    def output(self, temperature, ideal) -> np.ndarray:
        by_matrix = np.einsum("nij,nj->ni", self.matrix_at(temperature), ideal)
        return ideal + by_matrix + self.bias_at(temperature)

    def slope(self, temperature, ideal) -> np.ndarray:
        """(n, 3) change of the output per °C."""
        return (
            self.output(temperature + 0.5, ideal) - self.output(temperature - 0.5, ideal)
        )  # over 1 °C  # fmt: skip


def sensor(grade: Grade, triad: str, degree: int, low: float, high: float, triangular: bool, rng):
    """A device drawn at random; its parameters are polynomials of `degree` in temperature."""
    half = max((high - low) / 2, 5.0)
    middle = (high + low) / 2
    bias = np.zeros((degree + 1, 3))
    matrix = np.zeros((degree + 1, 3, 3))
    bias[0] = grade.bias[triad] * rng.standard_normal(3)
    matrix[0] = grade.matrix[triad] * rng.standard_normal((3, 3))
    for k in range(1, degree + 1):
        shrink = half * 0.35 ** (k - 1)
        signs = rng.choice([-1, 1], 3)
        bias[k] = signs * grade.slope[triad] * shrink * rng.uniform(0.4, 1.3, 3)
        diagonal = grade.scale[triad] * shrink * rng.standard_normal(3)
        matrix[k] = 0.1 * grade.scale[triad] * shrink * rng.standard_normal((3, 3))
        matrix[k][np.diag_indices(3)] = diagonal
    if triangular:
        matrix = np.tril(matrix)
    return Sensor(middle - half, middle + half, bias, matrix)


def plays(temperature: np.ndarray, widths: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Prandtl-Ishlinskii: a weighted stack of play (backlash) elements, each centred at the start."""
    out = np.zeros_like(temperature)
    for width, weight in zip(widths, weights, strict=True):
        inside = temperature[0]
        for i, x in enumerate(temperature):
            inside = min(max(inside, x - width), x + width)
            out[i] += weight * (inside - x)
    return out


def quantise(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step
