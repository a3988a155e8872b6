"""Simulated units of one type, whose noise is known, and what is expected of them."""

import jax
import numpy as np

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.learn_type_noise import pool
from inertiax.diagnose.noise.state_space import Variances
from inertiax.diagnose.problem import prepare
from inertiax.effects import CATALOGUE


G = 9.81
WHITE = 2e-4  # m/s², one sample
DWELL = 3e-4  # m/s², each positioning
FACES = np.concatenate([np.eye(3), -np.eye(3)]) * G
ORDER = list(Variances.__dataclass_fields__)


def unit(seed, *, dwell=DWELL, dwells=48, added=0.0, rig=None):
    """Rests of 6 s on faces at 2 Hz beside their reference: white noise, and an offset in each dwell."""
    rng = np.random.default_rng(seed)
    position = np.repeat(np.arange(dwells) % 6, 12)
    force = FACES[position]
    offset = np.repeat(dwell * rng.standard_normal((dwells, 3)), 12, axis=0)
    accel = 1.001 * force + 0.02 + offset + WHITE * rng.standard_normal(force.shape)
    accel = accel + added * np.linspace(-1.0, 1.0, len(accel))[:, None] * [0.0, 1.0, 0.0]
    moved = np.where(np.arange(len(position)) % 12 < 2, -1, position)
    time = 0.5 * np.arange(len(position))
    recording = Recording(time, accel=accel, reference_accel=force, position=moved)
    model = ModelChoice(accel_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(G), rig or Rig(), model, "tactical")


def pooled(campaigns):
    """The noise of units that are taken for consistent."""
    with jax.enable_x64(True):
        units = [(f"unit {k}", prepare(c, ()).triads) for k, c in enumerate(campaigns)]
        return pool(units, campaigns[0].rig)


def anova(campaign, channel):
    """Variance of a dwell's offset by the textbook: mean square between dwells less that within."""
    (recording,) = campaign.recordings
    rest = recording.position >= 0
    number = np.cumsum(np.r_[True, np.diff(recording.position) != 0])[rest]
    y, x = recording.accel[rest, channel], recording.reference_accel[rest]
    means = np.array([y[number == n].mean() for n in np.unique(number)])
    within = np.mean([y[number == n].var(ddof=1) for n in np.unique(number)])
    inputs = np.array([x[number == n].mean(axis=0) for n in np.unique(number)])
    base = np.c_[np.ones(len(means)), inputs]
    left = means - base @ np.linalg.lstsq(base, means, rcond=None)[0]
    return left @ left / (len(means) - 4) - within / 10


FEW = [e for e in CATALOGUE if e.name in ("drift", "warm_up", "second_order")]
