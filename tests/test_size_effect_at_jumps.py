"""Lever arms on a table whose station writes zeros for its rate while it moves: the reference jumps at each plateau."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose_campaign
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.diagnose.observations.model_rows import ModelForm
from inertiax.diagnose.observations.signals import axes_at_rest, change_of_rate


G, RATE = 9.81, 50.0  # m/s², Hz
_UP = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, 1, -1]]
)  # fmt: skip
AXES = np.concatenate([_UP, -_UP]) / np.tile(np.linalg.norm(_UP, axis=1), 2)[:, None]
ARMS = np.array([[3.4, 2.0, -1.0], [3.0, 2.3, -1.0], [3.0, 2.0, -1.2]]) * 1e-3  # m, by element


def matrices(seed):
    """Those of the accelerometers and of the gyros."""
    rng = np.random.default_rng(100 + seed)
    return 0.003 * np.tril(rng.standard_normal((3, 3))), 0.003 * rng.standard_normal((3, 3))


def campaign(rates=(1.0, -1.0, 3.0, -3.0, 5.0, -5.0), seed=0, arms=ARMS):
    """Six seconds at rest and three turns at each rate about 18 upward axes, a second of moving between them."""
    rng = np.random.default_rng(seed)
    force, rate, position = [], [], []
    for k, up in enumerate(AXES):
        for speed in (0.0, *rates):
            rows = int(6 * RATE) if speed == 0.0 else int(6 * np.pi / abs(speed) * RATE)
            force += [np.tile(G * up, (rows, 1)), np.zeros((50, 3))]
            rate += [np.tile(speed * up, (rows, 1)), np.zeros((50, 3))]
            position += [k if speed == 0.0 else -1] * rows + [-1] * 50
    force, rate = np.concatenate(force), np.concatenate(rate)
    moving = ~np.any(force, axis=1)
    true = np.where(moving[:, None], rng.normal(0.0, 0.5, rate.shape), rate)
    felt = np.where(moving[:, None], G * np.array([0.5, 0.5, 0.7]), force)
    added, (of_accel, of_gyro) = np.zeros_like(felt), matrices(seed)
    for k, arm in enumerate(arms):
        added[:, k] = (
            np.cross(true, np.cross(true, arm)) @ (np.eye(3) + of_accel)[k]
        )  # each element where it is, along its own axis
    accel = felt @ (np.eye(3) + of_accel).T + added + 0.05
    gyro = true @ (np.eye(3) + of_gyro).T + 0.01
    recording = Recording(
        time=np.arange(len(force)) / RATE,
        accel=accel + 5e-3 * rng.standard_normal(accel.shape),
        gyro=gyro + 5e-4 * rng.standard_normal(gyro.shape),
        position=np.array(position), reference_accel=force, reference_gyro=rate,
    )  # fmt: skip
    return Campaign((recording,), Site(G), Rig(), ModelChoice(temperature_degree=0))


def test_a_plateau_has_the_change_of_its_own_rows():
    log = join(campaign(rates=(5.0,)))
    change = change_of_rate(log, log.reference_gyro)
    assert np.abs(change).max() > 100.0  # from row to row, where the reference jumps
    blocks = cut(log)
    assert blocks.moving.sum() >= len(AXES)
    assert np.abs(blocks.mean(change)).max() < 1e-9  # rounding


def test_the_elements_axes_are_those_of_the_rests():
    """Arms of 34 mm add 0.85 m/s² at 5 rad/s, which bends a matrix that is fitted to all rows."""
    made = campaign(seed=3, arms=10.0 * ARMS)
    blocks = cut(join(made))
    form = ModelForm("accel", "reference", 0, (), 0.0, 1.0, G)
    true = np.eye(3) + matrices(3)[0]
    bent = np.eye(3) + 0.05
    found = axes_at_rest(blocks, form, bent)
    # 18 rests of 6 s at 50 Hz: 5 mm/s² / sqrt(300 * 18 / 3) / G to a matrix' element
    np.testing.assert_allclose(found, true, atol=5.0 * 5e-3 / np.sqrt(1800.0) / G)
    assert axes_at_rest(blocks[blocks.moving], form, bent) is bent  # no rests, none told


@pytest.mark.slow
def test_arms_across_the_axes_are_found_where_the_reference_jumps():
    """With the jumps' 250 rad/s² in the columns across an axis, arms of 2 and 3 mm were 0.1 ± 0.04 mm."""
    found, _ = diagnose_campaign(campaign(seed=1))
    (one,) = found.effects
    assert one.name == "size_effect" and len(one.channels) == 3
    for name, parameter in one.parameters:
        column, element = int(name[len("coefficient[")]), "xyz".index(name[-2])
        assert abs(parameter.value - ARMS[element, column]) < 4.0 * parameter.std, name
        assert parameter.std < 2e-5
