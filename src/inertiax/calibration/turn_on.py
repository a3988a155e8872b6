r"""How far two logs of a device differ at one temperature, its power having been off between them.

Bias is another after each power cycle (repeatability, IEEE 528), and a log of one pose shows it, with what hysteresis
or a lag behind the probe does: of gyros as the difference of the biases $\Delta = \nu_w(T_0) - \nu^0$; of
accelerometers, whose constants one pose does
not tell, along gravity alone,

$$\Delta = |f| - g, \quad f = (E + \Gamma)^{-1} (\bar a' + b_w(T_0) - a^0),$$

with the one pose's mean outputs $\bar a'$, from which its biases $b_w$ count. The Earth's rate is in $\Delta$ where the
gyros' biases were counted from zero.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .named_g_sensitivity import with_matrix_d
from .pytree import Calibration
from .triad import slot, TriadCalibration


_SIGMAS = 3.0  # beyond which a difference is none of noise


class Difference(NamedTuple):
    """Second log less first, and its 1 sigma, per axis or one number each."""

    value: Float[np.ndarray, "*axes"]
    sigma: Float[np.ndarray, "*axes"]

    @property
    def seen(self) -> bool:
        """Whether it is more than noise."""
        return bool(np.any(np.abs(self.value) > _SIGMAS * self.sigma))


class TurnOn(NamedTuple):
    """What a power cycle changed; `None` where the logs do not tell."""

    at: float  # °C
    gyro: Difference | None  # rad/s, of the biases
    gravity: Difference | None  # m/s², of |f| in the second log by the first's calibration, and g

    @property
    def seen(self) -> bool:
        """Whether the logs differ by more than their noise."""
        return any(d is not None and d.seen for d in (self.gyro, self.gravity))

    @property
    def sentence(self) -> str:
        """The same in words; nothing where neither triad tells anything."""
        parts = []
        if self.gyro is not None:
            axes = ", ".join(f"{x:+.4f}" for x in np.degrees(self.gyro.value))
            worst = np.degrees(self.gyro.sigma.max())
            parts.append(f"the gyros' biases by {axes} °/s in x, y, z (± {worst:.4f})")
        if self.gravity is not None:
            value, sigma = self.gravity
            parts.append(f"the force along gravity by {value:+.4f} m/s² (± {sigma:.4f})")
        if not parts:
            return ""
        said = (
            f"at {self.at:.1f} °C the warm-up differs from the calibration: {' and '.join(parts)}; "
        )
        if not self.seen:
            return said + "no more than their noise"
        return said + (
            "where the power was off between them that is turn-on bias, and the least to expect of the next time; "
            "slow noise, hysteresis, or a lag behind the probe as the board warms up, would explain it as well"
        )


def turn_on(calibration: Calibration, one_pose: Calibration, at: float) -> TurnOn:
    """How the outputs in one pose differ from what a calibration of another log makes of them.

    **Arguments:** `calibration` with constants; `one_pose` over temperatures that hold `at`, °C.
    """
    calibration = with_matrix_d(calibration)
    force, gravity, gyro = None, None, None
    if calibration.accel is not None and one_pose.accel is not None:
        force = _force(calibration.accel, one_pose.accel, at)
        if force is not None:
            sigma = _along(force, calibration.accel, one_pose.accel, at)
            size = float(np.linalg.norm(force))
            gravity = Difference(np.asarray(size - float(calibration.gravity)), sigma)
    if calibration.gyro is not None and one_pose.gyro is not None:
        (first, first_sigma), (second, second_sigma) = (
            _bias(t, at) for t in (calibration.gyro, one_pose.gyro)
        )
        by_force = np.zeros(3)
        if force is not None:
            d = np.asarray(calibration.gyro.parameters(at))[12:21].reshape(3, 3)
            by_force = d @ force / float(calibration.gravity)
        gyro = Difference(second - first - by_force, np.hypot(first_sigma, second_sigma))
    return TurnOn(at, gyro, gravity)


def _bias(
    triad: TriadCalibration, at: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The bias and its 1 sigma at one temperature."""
    values, sigmas = triad.over(np.array([at]))
    found, sigma = np.zeros(3), np.zeros(3)
    for k, name in enumerate(triad.names):
        if ".bias[" in name:
            found[slot(name)], sigma[slot(name)] = values[0, k], sigmas[0, k]
    return found, sigma


def _matrix(triad: TriadCalibration, at: float) -> Float[np.ndarray, "3 3"]:
    return np.eye(3) + np.asarray(triad.parameters(at), float)[3:12].reshape(3, 3)


def _force(
    fixed: TriadCalibration, moving: TriadCalibration, at: float
) -> Float[np.ndarray, "3"] | None:
    """The specific force in the one pose by the other log's calibration, m/s²."""
    if moving.mean_output is None:
        return None
    output = np.asarray(moving.mean_output, float) + _bias(moving, at)[0]
    return np.linalg.solve(_matrix(fixed, at), output - _bias(fixed, at)[0])


def _along(
    force: Float[np.ndarray, "3"], fixed: TriadCalibration, moving: TriadCalibration, at: float
) -> np.ndarray:
    """1 sigma of the force's size: d|f| = uᵀ (E + Γ)⁻¹ (db_w − da⁰ − dΓ f), u = f / |f|."""
    row = np.linalg.solve(_matrix(fixed, at).T, force / np.linalg.norm(force))
    variance = 0.0
    for triad in (fixed, moving):
        slope = np.zeros(len(triad.names))
        for k, name in enumerate(triad.names):
            place = slot(name)
            i, j = (place, None) if place < 3 else divmod(place - 3, 3)
            slope[k] = row[i] * (1.0 if j is None else force[j])
        phi = triad.curve.basis.rows(np.array([at]))[0]
        full = np.kron(phi, slope)
        variance += float(full @ np.asarray(triad.covariance) @ full)
    return np.asarray(np.sqrt(variance))
