"""Gyros alone on a rate table, whose upright axis tells the specific force; data from plain NumPy and SciPy."""

import math

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.vertical import upright_axis


EARTH = 7.292115e-5  # rad/s
LATITUDE = math.radians(50.0)
RATES = np.deg2rad([20.0, 60.0, 100.0])
STEP = 0.25  # s
REST, SPIN, MOVE = 60, 48, 24  # samples
D = np.array([4e-5, -3e-5, 5e-5])  # rad/s/g, of gyro_y


def rate_table(row, lean=0.0, latitude: float | None = LATITUDE, seed=1):
    """Six faces put on the table, which turns both ways about its axis; that axis may lean to the north."""
    rng = np.random.default_rng(seed)
    tilt = Rotation.from_rotvec([0.0, lean, 0.0])
    table = tilt.apply([0.0, 0.0, 1.0])  # its axis in the room: north, west and up
    room, rate, position = [], [], []
    last = None
    for number, face in enumerate([s * e for e in np.eye(3) for s in (1, -1)]):
        here = Rotation.align_vectors([face], [table])[0]
        if last is not None:
            turn = (here * last.inv()).as_rotvec()
            room += [Rotation.from_rotvec(s * turn) * last for s in (np.arange(MOVE) + 0.5) / MOVE]
            rate += [-turn / MOVE / STEP] * MOVE
            position += [-1] * MOVE
        room += [here] * REST
        rate += [np.zeros(3)] * REST
        position += [number] * REST
        last = here
        for speed in rng.permutation(np.r_[RATES, -RATES]):
            turned = speed * STEP * (np.arange(SPIN) + 0.5)
            room += [Rotation.from_rotvec(-a * face) * last for a in turned]
            rate += [speed * face] * SPIN
            position += [-1] * SPIN
            last = Rotation.from_rotvec(-speed * STEP * SPIN * face) * last
    axes = Rotation.concatenate(room).as_matrix()
    up = axes[:, :, 2]
    felt = np.array(rate) + EARTH * (np.cos(LATITUDE) * axes[:, :, 0] + np.sin(LATITUDE) * up)
    output = felt @ (np.eye(3) + 1e-3 * rng.standard_normal((3, 3))).T
    output = output + 1e-4 * rng.standard_normal(3) + 4e-5 * rng.standard_normal(felt.shape)
    output[:, 1] += up @ row
    recording = Recording(
        time=np.arange(len(felt)) * STEP, gyro=output, temperature=np.full((len(felt), 1), 25.0),
        position=np.array(position), reference_gyro=felt,
    )  # fmt: skip
    model = ModelChoice(gyro_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(9.81, latitude), Rig(1e-5, 1e-5), model, "tactical"), up


def test_the_upright_axis_of_the_table_is_the_specific_force():
    campaign, up = rate_table(0 * D)
    found = upright_axis(join(campaign))
    rest = campaign.recordings[0].position >= 0
    # The Earth rate is integrated while the device turns by 25 deg a sample; a degree is far less than D asks for.
    assert np.abs(found[rest] - up[rest]).max() < 0.02


@pytest.mark.parametrize("lean, latitude", [(0.1, LATITUDE), (0.0, None), (0.0, 0.5)])
def test_no_vertical_where_the_axis_leans_or_the_latitude_is_unknown_or_another(lean, latitude):
    assert upright_axis(join(rate_table(0 * D, lean, latitude)[0])) is None


@pytest.mark.slow
def test_g_sensitivity_is_found_without_accelerometers():
    with jax.enable_x64(True):
        found = diagnose(rate_table(D)[0])
    effect = max(found.effects, key=lambda e: e.evidence.delta_bic)
    # A further name may be one of the false alarms that are promised, of which 1.5 % of all triads have one.
    assert all(e.evidence.p_value > 1e-3 for e in found.effects if e is not effect)
    assert (effect.name, effect.channels) == ("g_sensitivity", ("gyro_y",))
    values = np.array([p.value for _, p in effect.parameters])
    errors = np.array([p.std for _, p in effect.parameters])
    assert np.all(np.abs(values - D) < 4.0 * errors)  # 4 sigma: a chance of 1e-4
    assert np.all(errors < 1e-5)


@pytest.mark.slow
def test_faces_alone_do_not_alarm():
    with jax.enable_x64(True):
        found = diagnose(rate_table(0 * D, seed=2)[0])
    assert found.verdict == "consistent"
