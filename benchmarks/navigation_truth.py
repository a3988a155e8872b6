"""The truth of `navigation_filter.py`: a flight, an IMU and its fixes, in NumPy alone and without the package.

The vehicle flies within 2 km of an origin on the WGS 84 ellipsoid, in axes east, north and up at the origin that
turn with
the Earth. Gravity comes from geodetic latitude and height of each point. What an ideal IMU reads is averaged over each
sample by Gauss and Legendre's rule of three points. Its errors are a' = (E + Γ(T)) a + b(T) + drift + white, with
Chebyshev polynomials in T drawn from the calibration's covariance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander


A, F, OMEGA = 6378137.0, 1 / 298.257223563, 7.292115e-5
E2 = F * (2 - F)
LATITUDE, HEIGHT = np.deg2rad(48.0), 400.0
RANGE = (-10.0, 50.0)  # °C, of the calibration
DEGREE = 2
ACCEL = [f"accel.bias[{i}]" for i in range(3)]
ACCEL += [f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)]
GYRO = [f"gyro.bias[{i}]" for i in range(3)]
GYRO += [f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)]


@dataclass(frozen=True)
class Sizes:
    """Of a tactical MEMS unit, SI."""

    accel_white: float = 6e-4  # m/s²/√Hz: 60 µg/√Hz
    accel_flicker: float = 2e-4  # m/s²: 20 µg
    accel_walk: float = 2e-6  # m/s²/√s
    gyro_white: float = 4.4e-5  # rad/s/√Hz: 0.15 °/√h
    gyro_flicker: float = 7e-6  # rad/s: 1.4 °/h
    gyro_walk: float = 5e-8  # rad/s/√s
    # What the calibration does not know, 1σ at its middle temperature; over its range 0.7 and 0.3 of it.
    accel_bias: float = 1e-2  # m/s²: 1 mg
    accel_matrix: float = 3e-4
    gyro_bias: float = 2e-4  # rad/s: 41 °/h
    gyro_matrix: float = 3e-4
    position: float = 0.1  # m, of fixes, 1 a second
    velocity: float = 0.02  # m/s
    tilt: float = np.deg2rad(0.3)  # at the start
    heading: float = np.deg2rad(1.0)


def covariance(names, sizes, rng):
    """Of a triad's coefficients, row-major (function of temperature, parameter), with correlations."""
    bias = sizes.accel_bias if names[0].startswith("accel") else sizes.gyro_bias
    matrix = sizes.accel_matrix if names[0].startswith("accel") else sizes.gyro_matrix
    one = np.array([bias if "bias" in n else matrix for n in names])
    sigma = np.concatenate([one * s for s in (1.0, 0.7, 0.3)])
    mix = np.eye(len(sigma)) + 0.5 * rng.normal(size=(len(sigma),) * 2) / np.sqrt(len(sigma))
    spread = mix @ mix.T
    unit = np.sqrt(np.diagonal(spread))
    return spread / np.outer(unit, unit) * np.outer(sigma, sigma)


# The Earth --------------------------------------------------------------------------------------


def _to_earth_axes():
    """Columns: east, north and up of the origin in Earth-centred axes (longitude 0)."""
    s, c = np.sin(LATITUDE), np.cos(LATITUDE)
    return np.array([[0, -s, c], [1, 0, 0], [0, c, s]])


def gravity(position):
    """Normal gravity at positions in the origin's axes, m/s²: Somigliana's value down the local plumb line."""
    axes = _to_earth_axes()
    normal = A / np.sqrt(1 - E2 * np.sin(LATITUDE) ** 2)
    origin = np.array(
        [
            (normal + HEIGHT) * np.cos(LATITUDE),
            0.0,
            (normal * (1 - E2) + HEIGHT) * np.sin(LATITUDE),
        ]
    )
    x, y, z = (origin + position @ axes.T).T
    across = np.hypot(x, y)
    latitude = np.full_like(x, LATITUDE)
    for _ in range(6):  # contracts by E2 at each turn
        normal = A / np.sqrt(1 - E2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + E2 * normal * np.sin(latitude), across)
    normal = A / np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    height = across / np.cos(latitude) - normal
    sin2 = np.sin(latitude) ** 2
    k = (1 - F) * 9.8321849378 / 9.7803253359 - 1
    surface = 9.7803253359 * (1 + k * sin2) / np.sqrt(1 - E2 * sin2)
    m = 0.00344978650684
    h = height / A
    size = surface * (1 - 2 * h * (1 + F + m - 2 * F * sin2) + 3 * h**2)
    up = np.stack(
        [x / across * np.cos(latitude), y / across * np.cos(latitude), np.sin(latitude)], 1
    )
    return -size[:, None] * (up @ axes)


EARTH = OMEGA * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])


# The flight -------------------------------------------------------------------------------------


class Flight:
    """Sums of sinusoids in position, heading, pitch and roll; each run has its own phases."""

    PERIODS = np.array([211.0, 83.0, 29.0])  # s
    SIZES = np.array([[400.0, 90.0, 12.0], [350.0, 100.0, 10.0], [15.0, 8.0, 2.0]])  # m
    ANGLE_PERIODS = np.array([[157.0, 47.0, 13.0], [41.0, 17.0, 7.0], [53.0, 19.0, 5.0]])  # s
    ANGLES = np.array([[2.0, 0.7, 0.1], [0.12, 0.1, 0.04], [0.3, 0.2, 0.05]])  # rad

    def __init__(self, rng):
        self.phases = rng.uniform(0, 2 * np.pi, (2, 3, 3))

    def _sum(self, t, sizes, periods, phases, order):
        w = 2 * np.pi / periods
        angle = t[:, None, None] * w + phases + order * np.pi / 2
        return np.sum(sizes * w**order * np.sin(angle), axis=2)

    def place(self, t, order=0):
        """Position, velocity or acceleration (order 0, 1, 2) at times t."""
        periods = np.broadcast_to(self.PERIODS, (3, 3))
        return self._sum(t, self.SIZES, periods, self.phases[0], order)

    def _angles(self, t, order=0):
        return self._sum(t, self.ANGLES, self.ANGLE_PERIODS, self.phases[1], order).T

    def attitude(self, t):
        """Case to level: heading about up, then pitch about x, then roll about y."""
        yaw, pitch, roll = self._angles(t)
        return _about(2, -yaw) @ _about(0, pitch) @ _about(1, roll)

    def read(self, t):
        """What ideal triads read at times t: specific force and absolute rate in the case."""
        yaw, pitch, roll = self._angles(t)
        yaw_rate, pitch_rate, roll_rate = self._angles(t, 1)
        x, y, z = np.eye(3)
        inner = _about(1, roll)
        middle = _about(0, pitch) @ inner
        turn = np.einsum("kji,kj->ki", middle, np.outer(-yaw_rate, z))
        turn += np.einsum("kji,kj->ki", inner, np.outer(pitch_rate, x)) + np.outer(roll_rate, y)
        case = self.attitude(t)
        rate = turn + np.einsum("kji,j->ki", case, EARTH)
        wanted = self.place(t, 2) + 2 * np.cross(EARTH, self.place(t, 1)) - gravity(self.place(t))
        return np.einsum("kji,kj->ki", case, wanted), rate


def _about(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = c
    turn[:, i, j], turn[:, j, i] = -s, s
    return turn


def averages(read, count, step):
    """Means over each step of what `read(t)` gives: three points, exact to the fifth power."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    force, rate = np.zeros((count, 3)), np.zeros((count, 3))
    for node, weight in zip(nodes, weights):
        f, w = read((np.arange(count) + 0.5 + 0.5 * node) * step)
        force += 0.5 * weight * f
        rate += 0.5 * weight * w
    return force, rate


# The IMU ----------------------------------------------------------------------------------------


def distort(outputs, names, coefficients, temperature):
    """(E + Γ(T)) a + b(T) for rows of ideal outputs, with one matrix of coefficients (function, parameter)."""
    x = (2 * temperature - sum(RANGE)) / (RANGE[1] - RANGE[0])
    values = chebvander(x, DEGREE) @ coefficients
    distorted = outputs.copy()
    for column, name in enumerate(names):
        kind, index = name.split("[")
        numbers = [int(i) for i in index.rstrip("]").split(",")]
        by = 1.0 if kind.endswith("bias") else outputs[:, numbers[1]]
        distorted[:, numbers[0]] += values[:, column] * by
    return distorted


def noise(count, step, white, flicker, walk, rng, times=(10.0, 100.0, 1000.0)):
    """White noise, random walk and the sum of Gauss-Markov processes of three channels, per sample."""
    total = white / np.sqrt(step) * rng.normal(size=(count, 3))
    total += np.cumsum(walk * np.sqrt(step) * rng.normal(size=(count, 3)), axis=0)
    variance = flicker**2 * np.log(times[1] / times[0]) / np.pi
    for time in times:
        left = np.exp(-step / time)
        driven = np.sqrt(variance * (1 - left**2)) * rng.normal(size=(count, 3))
        driven[0] = np.sqrt(variance) * rng.normal(size=3)
        total += _recursion(left, driven)
    return total


def _recursion(left, driven):
    """x_k = left·x_(k−1) + driven_k, in blocks: powers of `left` stay far from underflow within one."""
    block = 1000
    powers = left ** np.arange(block)
    out, carry = np.empty_like(driven), np.zeros(driven.shape[1])
    for first in range(0, len(driven), block):
        d = driven[first : first + block]
        p = powers[: len(d), None]
        out[first : first + len(d)] = p * (np.cumsum(d / p, axis=0) + left * carry)
        carry = out[first + len(d) - 1]
    return out


def temperature(count, step):
    """0 to 40 °C and back in 20 minutes, again and again, °C."""
    return 20.0 - 20.0 * np.cos(2 * np.pi * np.arange(count) * step / 1200.0)
