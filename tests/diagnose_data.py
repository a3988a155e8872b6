"""Simulated campaigns for diagnoses: tumbles and sweeps with noise, and effects of one channel."""

import numpy as np

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site


G = 9.81
WHITE = 2e-4  # m/s², one sample
FLICKER = 6e-5  # m/s², slow noise common in real accelerometers


def slow_noise(rng, time):
    """Three relaxations a decade apart, by recursion: close to 1/f between 0.001 and 0.1 Hz."""
    total = np.zeros(len(time))
    step = np.diff(time, prepend=time[0])
    for tau in (10.0, 100.0, 1000.0):
        decay = np.exp(-step / tau)
        state = rng.standard_normal()
        for k, a in enumerate(decay):
            state = a * state + np.sqrt(1.0 - a * a) * rng.standard_normal()
            total[k] += state
    return FLICKER * total


def poses(step=30.0):
    """A tumble in each of three planes."""
    angle = np.radians(np.arange(0.0, 360.0, step))
    made = []
    for k in range(3):
        for a in angle:
            force = np.zeros(3)
            force[k], force[(k + 1) % 3] = np.cos(a), np.sin(a)
            made.append(force)
    return np.array(made)


def tumble(seed=0, effect=None, sessions=2, step=30.0):
    """Sessions at constant temperature; 10 s at rest in each position, 2 s between them, 4 Hz."""
    rng = np.random.default_rng(seed)
    force, position, experiment = [], [], []
    for session in range(sessions):
        for number, pose in enumerate(poses(step)):
            force += [pose] * 48
            position += [-1] * 8 + [number] * 40
            experiment += [session] * 48
    force, position = np.array(force), np.array(position)
    time = np.arange(len(force)) * 0.25
    bias, matrix = (
        np.array([0.02, -0.03, 0.01]),
        np.array([[1e-3, 0, 0], [2e-3, -2e-3, 0], [-1e-3, 1e-3, 3e-3]]),
    )
    output = G * force @ (np.eye(3) + matrix).T + bias
    if effect is not None:
        output = output + effect(force, time)
    output = output + np.stack([slow_noise(rng, time) for _ in range(3)], axis=1)
    output = output + WHITE * rng.standard_normal(output.shape)
    recording = Recording(
        time=time, accel=output, position=position, experiment=np.array(experiment)
    )
    model = ModelChoice(accel_estimator="invariant", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(1e-5), model, "tactical")


def sweep(seed=0, effect=None, step=1.0):
    """One pose; up, soak, down, soak, up again faster; a gyro with a cubic in temperature, read each `step` seconds."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 5000.0, step)
    corner = [0, 300, 1500, 2000, 3200, 3600, 4300, 5000]
    air = np.interp(time, corner, [-10, -10, 50, 50, -10, -10, 50, 50])
    probe = np.empty_like(air)
    state = air[0]
    for k, value in enumerate(air):
        state += (value - state) * step / 40.0
        probe[k] = state
    x = (probe - 20.0) / 30.0
    output = 1e-4 * np.stack([x - 0.3 * x**2, 0.5 * x + 0.2 * x**3, x**2], axis=1)
    if effect is not None:
        output = output + effect(probe, time)
    output = output + 2e-6 * rng.standard_normal(output.shape)
    recording = Recording(
        time=time, gyro=output, temperature=probe[:, None] + 0.003 * rng.standard_normal((len(time), 1)),
        position=np.zeros(len(time), int), experiment=time.astype(int) // 1000,
    )  # fmt: skip
    model = ModelChoice(gyro_estimator="static", temperature_degree=3)
    return Campaign((recording,), Site(G), Rig(), model, "tactical")


def only(channel, values):
    added = np.zeros((len(values), 3))
    added[:, channel] = values
    return added


def still(seconds=2000.0, white=1e-4):
    """One accelerometer triad at rest in one pose with white noise only, 2 Hz, a constant model."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, seconds, 0.5)
    accel = np.array([0.0, 0.0, G]) + white * rng.standard_normal((len(time), 3))
    recording = Recording(time, accel=accel, position=np.zeros(len(time), int))
    model = ModelChoice(accel_estimator="static", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "navigation")


STEP = 0.25  # s
ANGLE, RATE = 3e-4, 1e-5  # what the rig promises


def oblique(seed, *, product=0.0, promised=1.0, flat=16):
    """A rate table of twelve axes, most of them oblique, ± three rates: rig errors, 20 µrad/s in each dwell, noise.

    `product` is the coefficient of ωx ωy on gyro x, s/rad; the rig is better than it promises by `promised`;
    `flat` are the samples of a plateau.
    """
    rng = np.random.default_rng(seed)
    axes = np.array(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1],
         [1, -1, 0], [0, 1, -1], [-1, 0, 1], [1, 1, 1], [-1, 1, 1], [1, -1, 1]], float,
    )  # fmt: skip
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    reading, output = [], []
    # Axis after axis at each rate: the table is positioned anew for every plateau.
    for rate in np.deg2rad([20.0, -20.0, 60.0, -60.0, 100.0, -100.0]):
        for axis in axes:
            w = rate * axis
            error = np.cross(w, promised * ANGLE * rng.standard_normal(3))
            error += promised * RATE * rng.standard_normal() * w
            error += 2e-5 * rng.standard_normal(3)
            error[0] += product * w[0] * w[1]
            reading += [np.tile(w, (flat, 1)), np.zeros((8, 3))]
            output += [np.tile(w + error, (flat, 1)), np.zeros((8, 3))]
    reading, output = np.concatenate(reading), np.concatenate(output)
    output = output + 1e-5 + 3e-5 * rng.standard_normal(output.shape)
    recording = Recording(
        STEP * np.arange(len(reading)), gyro=output, reference_gyro=reading,
        position=np.full(len(reading), -1),
    )  # fmt: skip
    model = ModelChoice(gyro_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(9.81), Rig(ANGLE, RATE), model, "consumer")


TAU = 30.0  # s
SLOPE = np.array([4e-4, -3e-4, 5e-4])  # m/s²/K, of the biases


def behind(time, probe, lags):
    """Temperature of an element that follows the probe by small steps."""
    made, state = np.empty_like(probe), probe[0]
    step = np.diff(time, prepend=time[0])
    for k, (value, dt) in enumerate(zip(probe, step)):
        state += (value - state) * -np.expm1(-dt / lags)
        made[k] = state
    return made
