"""`check` tells a latitude that the gyros contradict from a g-sensitivity, by rows made here in NumPy."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


G, OMEGA = 9.81, 7.292115e-5
RESTS, ROWS, RATE = 36, 400, 50.0
SIN, COS = np.sin(np.deg2rad(52.5)), np.cos(np.deg2rad(52.5))
NONE = np.zeros((3, 3))
ALIKE = 2.0 * SIN * OMEGA * np.eye(3)  # rad/s/g, as large as the error of a mirrored latitude


def poses():
    """Directions of the vertical spread over the sphere, and north beside each."""
    k = np.arange(RESTS) + 0.5
    z, angle = 1.0 - 2.0 * k / RESTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z**2)
    up = np.random.default_rng(0).permutation(
        np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    )
    level = np.cross(up, [0.3, 0.8, -0.5])
    return up, level / np.linalg.norm(level, axis=1, keepdims=True)


def told(*, stated=52.5, sensitivity=NONE, reads=1.0, seed=1, noise=1e-4):
    """Findings of rests at 52.5° with references of a stated latitude; gyros read a part of the Earth's rate."""
    rng, (up, north) = np.random.default_rng(seed), poses()
    each = lambda x: np.repeat(x, ROWS + 50, axis=0)
    earth = lambda s, c: OMEGA * (s * up + c * north)
    lat = np.deg2rad(stated)
    gyro = reads * earth(SIN, COS) + up @ sensitivity.T + [2e-3, -1e-3, 3e-3]
    label = np.concatenate([np.r_[np.full(ROWS, k), np.full(50, -1)] for k in range(RESTS)])
    n = len(label)
    turning = (label < 0)[:, None]
    recording = Recording(
        time=np.arange(n) / RATE,
        accel=each(G * up) + 2e-3 * rng.standard_normal((n, 3)),
        gyro=each(gyro) + noise * rng.standard_normal((n, 3)) + 0.5 * turning,
        position=label,
        reference_accel=each(G * up),
        reference_gyro=each(earth(np.sin(lat), np.cos(lat))) + 0.5 * turning,
        name="log.csv",
    )  # fmt: skip
    found = check_campaign(Campaign((recording,), Site(gravity=G, latitude=lat))).findings
    return [f for f in found if f.kind == "latitude"]


def test_a_mirrored_latitude_is_named_with_the_right_one_and_beside_it_what_looks_the_same():
    (found,) = told(stated=-52.5)
    evidence = dict(found.evidence)
    assert found.severity == "warning" and found.remedy == "[site]\nlatitude = 52.5"
    assert abs(evidence["latitude"] - 52.5) < 4.0 * evidence["std"] < 10.0
    assert "alike on all axes" in found.statement
    # The rows cannot tell a g-sensitivity alike on all axes from it: what is said holds both.
    (found,) = told(sensitivity=-ALIKE)
    assert "alike on all axes" in found.statement


def test_gyros_that_read_nothing_of_the_earths_rate_are_said_to():
    (found,) = told(reads=0.0)
    assert "read nothing of the Earth's rate" in found.statement and found.remedy is None


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.0, 20.0, 500.0])  # °/h/g
def test_a_right_latitude_is_not_contradicted_by_the_gyros_own_g_sensitivity(size):
    own = np.array([[1.0, -0.3, 0.2], [0.1, -0.8, 0.0], [0.4, 0.2, 0.6]])
    for seed in range(3):
        assert not told(sensitivity=np.deg2rad(size / 3600.0) * own, seed=seed)


def test_what_no_latitude_has_is_not_said():
    assert not told(sensitivity=4.0 * ALIKE)
