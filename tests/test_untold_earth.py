"""Earth's rate on a table whose angles are lost is not taken for the gyros' g-sensitivity."""

import functools

import equinox as eqx
import jax
import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.misfit_pattern import FORCE, FORCE_OR_HEADING, misfit_pattern, remedy
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibrate.untold_earth import is_no_more, no_reference_tells
from inertiax.data.campaign import load_campaign
from inertiax.diagnose import diagnose
from inertiax.estimators import GravityRotation
from inertiax.physics.temperature import Constant
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.motions import Motions
from table_of_two_axes import EARTH, GRAVITY, LATITUDE, RATE, readings, smooth


OUTER = (0.0, 45.0, 90.0, 135.0, 180.0, -90.0)
POSES = np.array([(o, i) for o in OUTER for i in (0.0, 45.0, 90.0, 135.0)])  # deg, outer and inner


@functools.cache
def poses():
    """The case's attitudes at 20 poses of a table whose outer axis points east."""
    outer, inner = (np.deg2rad(POSES[:, [k]]) for k in range(2))
    return Rotation.from_euler("x", outer) * Rotation.from_euler("z", inner)


def followed(sensitivity, *, told=False):
    """What rests follow with Earth's horizontal rate and a D, rad/s per g, in the gyros' means."""
    up, north = (poses().inv().apply(v) for v in ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]))
    earth = EARTH * np.cos(np.deg2rad(LATITUDE)) * north
    noise = 2e-6 * np.random.default_rng(3).standard_normal(up.shape)
    gyro = 0.01 + (0.0 if told else earth) + up @ sensitivity.T + noise
    count = len(up)
    with jax.enable_x64(True):
        dwells = Dwells.from_arrays(
            GRAVITY * up, gyro, sigma=(1e-4, 4e-5), reference_gyro=earth if told else None
        )
        still = Motions(
            gyro=np.zeros((count, 4, 3)), step=np.zeros((count, 3)), start_force=GRAVITY * up,
            start_covariance=np.zeros((count, 3, 3)), noise=np.zeros(count),
            valid=np.ones(count, bool),
        )  # fmt: skip
        dwells = eqx.tree_at(lambda d: d.motion, dwells, still, is_leaf=lambda x: x is None)
        estimator = GravityRotation(gravity=GRAVITY)
        return misfit_pattern(estimator, Constant(), np.zeros((1, 12)), dwells)


def test_no_g_sensitivity_is_advised_that_the_earths_rate_explains():
    found = followed(np.zeros((3, 3)))
    assert found == FORCE_OR_HEADING
    assert "g_sensitivity = true" not in remedy(found, "gyro")


def test_one_that_is_larger_is_advised_and_one_beside_a_reference_that_tells():
    assert followed(5.0 * EARTH * np.diag([1.0, -1.0, 0.5])) == FORCE
    assert followed(0.7 * EARTH * np.diag([1.0, -1.0, 0.5]), told=True) == FORCE


def test_references_without_earths_rate_tell_none():
    assert no_reference_tells(None) and no_reference_tells(np.zeros((5, 3)))
    assert not no_reference_tells(np.full((5, 3), 0.5 * EARTH))
    assert is_no_more(np.full(9, 1.9 * EARTH)) and not is_no_more([0.0, -2.1 * EARTH])


def campaign(folder, sensitivity):
    """A log of the table without its angles, with good gyros; `sensitivity` is their D, rad/s per g."""
    rng = np.random.default_rng(2)
    held = [np.zeros((300, 2))]
    for pose in POSES:
        way = zip(held[-1][-1], pose, strict=True)
        held.append(np.stack([smooth(a, b, 3.0) for a, b in way], axis=1))
        held.append(np.tile(pose, (300, 1)))  # 6 s
    force, rate = readings(np.concatenate(held))
    gyro = rate + 2e-3 + force @ sensitivity.T / GRAVITY + rng.normal(0.0, 4e-5, rate.shape)
    accel = force + rng.normal(0.0, 2e-3, force.shape)
    time = np.arange(len(rate)) / RATE
    names = ["time", *(f"{t}_{c}" for t in ("accel", "gyro") for c in "xyz")]
    folder.mkdir()
    pl.DataFrame(np.column_stack([time, accel, gyro]), names).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(
        f"[site]\ngravity = {GRAVITY}\nlatitude = {LATITUDE}\n[recordings]\n"
        'files = ["log.csv"]\n[model]\ng_sensitivity = true\n'
    )
    return folder


@pytest.mark.slow
def test_a_d_of_that_size_is_reserved_and_a_larger_one_is_not(tmp_path):
    def said(name, size):
        folder = campaign(tmp_path / name, size * np.diag([1.0, -1.0, 0.5]))
        result = calibrate_device(load_campaign(folder))
        return " ".join(f.text for f in judge(result).findings if not f.fine)

    word = "no larger than the Earth's rate makes"
    assert word in said("lost", 0.0)
    assert word not in said("large", 1e-3)


@pytest.mark.slow
def test_a_diagnosis_has_both_names(tmp_path):
    folder = campaign(tmp_path / "lost", np.zeros((3, 3)))
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.partition("[model]")[0])
    effects = diagnose(load_campaign(folder)).effects
    named = [e for e in effects if e.name == "g_sensitivity"]
    assert named, [e.name for e in effects]
    assert all("earth_rate" in e.alternatives for e in named)
