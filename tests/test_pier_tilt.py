"""A pier out of level, seen by accelerometers on a table whose turns are logged; data from plain NumPy and SciPy."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.problem import prepare
from inertiax.effects import CATALOGUE


G = 9.81
EARTH = 7.292115e-5  # rad/s
LATITUDE = np.deg2rad(50.0)
REST, MOVE = 8, 8  # samples of one second
TILT = np.array([6e-5, -8e-5])  # rad, about north and about west


def attitudes(rng):
    """Room (north, west, up) to case in 18 positions, each turned about the vertical by a multiple of 90°."""
    eye = np.eye(3)
    faces = [s * e for e in eye for s in (1, -1)]
    edges = [
        (s * eye[i] + t * eye[j]) / np.sqrt(2.0)
        for i, j in ((0, 1), (0, 2), (1, 2))
        for s in (1, -1)
        for t in (1, -1)
    ]
    for up in (*faces, *edges):
        to_up = Rotation.align_vectors([up], [[0.0, 0.0, 1.0]])[0]
        yield to_up * Rotation.from_euler("z", rng.integers(4) * np.pi / 2)


def tumble(tilt, seed=3):
    """Three rounds of the positions in one recording; what the table reports holds its own turns and the Earth's."""
    rng = np.random.default_rng(seed)
    stops = list(attitudes(rng))
    order = [k for _ in range(3) for k in rng.permutation(len(stops))]
    room, rate, position = [], [], []
    last = stops[order[0]]
    for k in order:
        turn = (stops[k] * last.inv()).as_rotvec()
        share = (np.arange(MOVE) + 0.5) / MOVE  # a constant rate, so that its integral is exact
        room += [Rotation.from_rotvec(s * turn) * last for s in share]
        rate += [-turn / MOVE] * MOVE
        room += [stops[k]] * REST
        rate += [np.zeros(3)] * REST
        position += [-1] * MOVE + [k] * REST
        last = stops[k]
    axes = Rotation.concatenate(room).as_matrix()  # columns: north, west and up in the case
    earth = EARTH * (np.cos(LATITUDE) * axes[:, :, 0] + np.sin(LATITUDE) * axes[:, :, 2])
    up = axes[:, :, 2]
    lean = np.cross(axes[:, :, :2] @ tilt, up)
    matrix = np.eye(3) + 1e-3 * rng.standard_normal((3, 3))
    output = G * (up + lean) @ matrix.T + 0.01 * rng.standard_normal(3)
    output = output + 3e-4 * rng.standard_normal(up.shape)
    recording = Recording(
        time=np.arange(len(up)) * 1.0, accel=output, temperature=np.full((len(up), 1), 25.0),
        position=np.array(position), reference_accel=G * up, reference_gyro=np.array(rate) + earth,
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(1e-5), model, "tactical")


@pytest.mark.slow
def test_a_pier_out_of_level_from_the_start_is_named_and_sized():
    with jax.enable_x64(True):
        found = diagnose(tumble(TILT))
    assert found.verdict == "missing-physics"
    (effect,) = found.effects
    assert effect.name == "pier_tilt"
    assert effect.channels == ("accel_x", "accel_y", "accel_z")
    values = np.array([p.value for _, p in effect.parameters])
    errors = np.array([p.std for _, p in effect.parameters])
    assert len(values) == 2  # about two horizontal axes, constant in time
    # Which horizontal axes the tool takes is its own affair where the Earth rate tells north: north and west.
    assert np.all(np.abs(values - TILT) < 4.0 * errors)  # 4 sigma: a chance of 1e-4
    assert np.all(errors < 1.5e-5)


@pytest.mark.slow
def test_the_vertical_axis_of_a_tilt_is_no_candidate_for_accelerometers():
    tilt = [e for e in CATALOGUE if e.name == "pier_tilt"]
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(TILT), tilt).triads
    listed = [t for t in prepared.candidates if t.name == "pier_tilt"]
    columns = {t.variant.label: t.columns[0].shape[1] for t in listed}
    assert columns == {"24 h": 4, "linear": 2, "constant": 2}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
def test_a_level_pier_is_left_alone(seed):
    with jax.enable_x64(True):
        found = diagnose(tumble(np.zeros(2), seed))
    assert found.verdict == "consistent"


def test_turning_through_gravity_is_no_noise():
    """Errors of the matrix, 1e-3 of gravity, follow each turn and are 30 times the noise of 3e-4 m/s²."""
    tilt = [e for e in CATALOGUE if e.name == "pier_tilt"]
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(np.zeros(2)), tilt).triads
    blocks = prepared.blocks
    per_sample = np.sqrt(blocks.accel_white * blocks.count[:, None])
    assert blocks.moving.any()
    # 53 plateaus of two blocks of four samples: 318 degrees of freedom, so 4 % (1 sigma) each.
    np.testing.assert_allclose(per_sample[blocks.moving], 3e-4, rtol=0.16)
    np.testing.assert_allclose(per_sample[~blocks.moving], 3e-4, rtol=0.16)
