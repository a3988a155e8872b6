"""What the rows of a diagnosis know beside the outputs: the probe's error, and how large a misalignment can be."""

import jax
import numpy as np

from inertiax.diagnose.engine import prepare
from inertiax.recordings import Campaign, ModelChoice, Recording, Rig, Site


G = 9.81
FACES = np.concatenate([np.eye(3), -np.eye(3)]) * G


def faces(misalignment, *, turns, degree, bias_slope=0.0, rig=None, seed=1):
    """Rests of 20 s on six faces, 2 Hz, while the chamber goes from 0 to 50 °C; no reference.

    `misalignment` is Γ's element (1, 0), `bias_slope` that of x in m/s² per °C, white noise of 0.2 mm/s² and 0.2 mm/s²
    more in each dwell.
    """
    rng = np.random.default_rng(seed)
    position = np.repeat(np.tile(np.arange(6), turns), 40)
    time = 0.5 * np.arange(len(position))
    temperature = np.linspace(0.0, 50.0, len(time))
    force = FACES[position]
    accel = force.copy()
    accel[:, 1] += misalignment * force[:, 0]
    accel[:, 0] += bias_slope * temperature
    accel += 2e-4 * rng.standard_normal(accel.shape)
    accel += np.repeat(2e-4 * rng.standard_normal((6 * turns, 3)), 40, axis=0)
    moved = np.where((np.arange(len(time)) % 40) < 2, -1, position)
    recording = Recording(time, accel=accel, temperature=temperature[:, None], position=moved)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=degree)
    return Campaign((recording,), Site(G), rig or Rig(), model, "tactical")


def prepared(campaign):
    with jax.enable_x64(True):
        return prepare(campaign, ())[1][0]


def test_misalignments_that_faces_do_not_tell_stay_of_usual_size():
    # |a| on a face knows a misalignment m by m²/2 alone: 0.2 mm/s² of dwell noise lets m be anything up to
    # sqrt(2 * 2e-4 / 9.81) = 6e-3 and far more in the combinations that scale factors follow. 0.02 rad is usual.
    for seed in range(4):
        base = prepared(faces(3e-3, turns=20, degree=3, seed=seed)).system.base
        angles = [base.coefficients[3 + k] for k, (i, j) in enumerate(base.form.matrix) if i != j]
        assert np.abs(np.array(angles)[:, 0]).max() < 0.04  # two of its usual sizes
        assert np.abs(np.array(angles)[:, 1:]).max() < 0.004


def test_the_probe_counts_by_the_slope_of_the_outputs_and_its_stated_uncertainty():
    campaign = faces(0.0, turns=8, degree=1, bias_slope=2e-3, rig=Rig(temperature_uncertainty=0.1))
    one = prepared(campaign)
    (heated,) = (chain.heated for chain in one.system.chains)
    # By hand: |a| feels the bias of x by the direction's x, so 0.1 °C are 2e-4 m/s² on faces ±x and nothing on others.
    direction = FACES[one.blocks.position] / G
    # The fitted slope of a bias is known to 2e-4 / (15 °C sqrt(16 dwells)) = 3e-6 of 2e-3; ten of them.
    assert np.allclose(heated[:, 0], 2e-4 * direction[:, 0], atol=4e-6)


def test_without_a_stated_uncertainty_the_probe_does_not_count():
    one = prepared(faces(0.0, turns=8, degree=1, bias_slope=2e-3))
    assert all(chain.heated.shape[1] == 0 for chain in one.system.chains)
