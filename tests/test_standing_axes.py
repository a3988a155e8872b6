"""An axis that stands keeps its positioning error: which rests and plateaus share it, and what a diagnosis makes of it.

The table of `benchmarks/two_axis_tables.py` is SciPy's rotations and NumPy.
"""

import dataclasses
import importlib.util
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Rig
from inertiax.diagnose.wording.explain import share_of_axes
from inertiax.reduction.standing_axes import angles_of_axes, standing_errors


ALPHA = 5e-5  # rad
UP = np.array([0.0, 0.0, 9.81])
EARTH = 7.292115e-5 * np.array([np.cos(0.84), 0.0, np.sin(0.84)])  # north, west, up
WEST = (0.0, 1.0, 0.0)
STATED = Rig(ALPHA, axes=(WEST, (0.0, 0.0, 1.0)))


@pytest.fixture(scope="module")
def tables():
    path = Path(__file__).parents[1] / "benchmarks" / "two_axis_tables.py"
    spec = importlib.util.spec_from_file_location("two_axis_tables", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def case_at(outer, inner) -> Rotation:
    out = Rotation.from_rotvec(np.multiply.outer(np.deg2rad(outer), WEST))
    return out * Rotation.from_rotvec(np.multiply.outer(np.deg2rad(inner), [0.0, 0.0, 1.0]))


def dwells(plan):
    """Position, force and rate of rests at two angles, or of whole turns about an axis there."""
    position, force, rate = [], [], []
    arcs = np.arange(36) * 10.0
    for outer, inner, *turns in plan:
        case, speed = case_at(outer, inner), np.zeros(3)
        position.append(-1 if turns else len(position))
        if turns == ["outer"]:
            speed = 0.5 * case.apply(WEST, inverse=True)
            case = case_at(outer + arcs, np.full(36, inner))
        elif turns == ["inner"]:
            speed = np.array([0.0, 0.0, 0.5])
            case = case_at(np.full(36, outer), inner + arcs)
        force.append(case.apply(UP, inverse=True).reshape(-1, 3).mean(axis=0))
        rate.append(speed + case.apply(EARTH, inverse=True).reshape(-1, 3).mean(axis=0))
    return np.array(position), np.array(force), np.array(rate)


def groups(found):
    """The dwells of each standing that has an error."""
    made = np.abs(found.accel).max(axis=1).reshape(len(found.accel), -1, 3).max(axis=2) > 0.0
    return sorted(tuple(np.flatnonzero(column).tolist()) for column in made.T)


def test_rests_share_the_error_of_the_axis_that_stands():
    plan = [(0, 0), (0, 90), (0, 180), (90, 180), (90, 270), (45, 30)]
    found = standing_errors(*dwells(plan), STATED)
    # The outer axis stands through 0 to 2 and through 3 and 4, the inner one through 2 and 3; 5 shares nothing.
    assert groups(found) == [(0, 1, 2), (2, 3), (3, 4)]
    np.testing.assert_allclose(found.part, [0.5, 0.5, 1.0, 1.0, 0.5, 0.0])


def test_a_mean_over_turns_has_the_outer_axis_error_of_the_rests_beside_it():
    plan = [
        (90, 0),
        (90, 0, "inner"),
        (90, 0, "inner"),
        (90, 40),
        (0, 40),
        (0, 40, "outer"),
        (20, 40),
    ]
    found = standing_errors(*dwells(plan), STATED)
    # A turn about the inner axis leaves the outer one standing; one about the outer is a positioning of its own. The
    # inner axis stands from 3 to the end.
    assert groups(found) == [(0, 1, 2, 3), (3, 4, 6), (5,)]
    # Of a level axis the mean over turns keeps what it leans by: g ε along it.
    along = found.accel[1, 2].reshape(-1, 3)
    assert np.linalg.norm(along) == pytest.approx(np.sqrt(0.5) * ALPHA * 9.81, rel=1e-3)
    np.testing.assert_allclose(found.accel[1, :2], 0.0, atol=1e-12)


def test_errors_are_those_of_small_rotations_of_the_axes():
    """To all orders by SciPy, of an outer axis and an inner one turned by 1e-6 rad; they differ by 1e-12 of g."""
    plan = [(0, 0), (0, 70), (130, 70)]
    position, force, rate = dwells(plan)
    found = standing_errors(position, force, rate, STATED)
    size, errors = 1e-6, found.accel.reshape(3, 3, -1, 3) / (np.sqrt(0.5) * ALPHA)
    for axis in range(3):
        turn = Rotation.from_rotvec(size * np.eye(3)[axis])
        for k in (0, 1):
            moved = (turn * case_at(*plan[k])).inv().apply(UP) - force[k]
            np.testing.assert_allclose(-moved / size, errors[k, :, 0, axis], atol=1e-4)
        for k in (1, 2):
            moved = (case_at(*plan[k]) * turn).inv().apply(UP) - force[k]
            np.testing.assert_allclose(-moved / size, errors[k, :, 1, axis], atol=1e-4)


def test_a_station_may_state_each_axis():
    told = dwells([(0, 0), (0, 90), (90, 90)])
    found = standing_errors(*told, dataclasses.replace(STATED, outer_part=0.8))
    np.testing.assert_allclose(found.part, [0.8, 1.0, 0.2])
    whole = standing_errors(*told, STATED).accel
    np.testing.assert_allclose(found.accel[..., :3], np.sqrt(1.6) * whole[..., :3])
    np.testing.assert_allclose(found.accel[..., 3:], np.sqrt(0.4) * whole[..., 3:])


def test_a_campaign_states_both_axes_or_their_sum(tables, tmp_path):
    tables.write(tmp_path / "table", 1, 8.0, "")
    file = tmp_path / "table" / "campaign.toml"
    before = file.read_text()
    alone = before.replace("position_uncertainty = 11.3", "axis_uncertainty = [3.0, 4.0]  # 11.3")
    file.write_text(alone)
    rig = load_campaign(file).rig
    assert rig.position_uncertainty == pytest.approx(np.deg2rad(5.0 / 3600.0))
    assert rig.outer_part == pytest.approx(9.0 / 25.0)
    one_axis = alone.replace('["east", "up"]', '["east"]').replace('"outer", "inner"', '"outer"')
    for text, words in (
        (before.replace("[rig]", "[rig]\naxis_uncertainty = [3.0, 4.0]"), "state one of them"),
        (one_axis, "two .table. axes tell"),
        (alone.replace("[3.0, 4.0]", "[3.0, -4.0]"), "axis_uncertainty = -4 must be 0 or more"),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=words):
            load_campaign(file)


def test_init_offers_both_for_a_table_with_two_axes(tables, tmp_path):
    tables.write(tmp_path / "table", 1, 8.0, "")
    said = draft_campaign(tmp_path / "table" / "log.parquet", tmp_path).text
    assert "each positioning; or axis_uncertainty = [8.0, 6.0], outer, inner" in said


def test_nothing_is_shared_where_axes_or_headings_are_not_known():
    told = dwells([(0, 0), (0, 90), (0, 180)])
    assert standing_errors(*told, Rig(ALPHA)) is None
    assert standing_errors(*told, dataclasses.replace(STATED, position_uncertainty=None)) is None
    assert standing_errors(told[0], told[1], 0.0 * told[2], STATED) is None
    # Files are not one standing: nobody knows what was done between them.
    assert standing_errors(*told, STATED, run=np.array([0, 1, 2])) is None


def test_devices_of_a_fleet_have_their_own_and_rows_that_pad_have_none():
    position, force, rate = (
        np.stack([x, x]) for x in dwells([(0, 0), (0, 90), (0, 180), (90, 180)])
    )
    valid = np.array([[True] * 4, [True, True, False, False]])
    found = standing_errors(position, force, rate, STATED, valid=valid)
    np.testing.assert_allclose(found.part, [[0.5, 0.5, 1.0, 0.5], [0.5, 0.5, 0.0, 0.0]])
    assert found.accel.shape == found.gyro.shape == (2, 4, 3, 6)
    assert not found.accel[1, 2:].any() and not found.accel[1, :, :, 3:].any()


def test_what_a_station_seems_to_err_by_says_what_each_axis_was_given():
    """Of 10″ in all, 6″ and 8″ where 0.36 of the square is the outer axis'; 7.07″ each where nobody says."""
    stated = dataclasses.replace(
        STATED, position_uncertainty=10.0 * np.pi / 648000, outer_part=0.36
    )
    said = share_of_axes(angles_of_axes(stated))
    assert "outer axis is taken to err by 6 arcsec and the inner one by 8" in said
    half = share_of_axes(angles_of_axes(Rig(10.0 * np.pi / 648000, axes=STATED.axes)))
    assert "by 7.07 arcsec and the inner one by 7.07" in half and "axis_uncertainty" in half
    assert share_of_axes(None) == share_of_axes(angles_of_axes(Rig(axes=STATED.axes))) == ""


@pytest.mark.slow
def test_a_plain_campaign_of_such_a_table_is_consistent(tables, tmp_path):
    """Errors of 8″ of each axis; before axes stood in the model, all of such campaigns had a tilt of the pier named.
    What is hidden in them and named is in the benchmark."""
    tables.write(
        tmp_path / "plain", 41, 8.0, "", outer_angles=(0, 90, 180, 45), stairs=(60.0, -60.0)
    )
    with jax.enable_x64(True):
        plain = tables.judged(tmp_path / "plain")
    assert plain["verdict"] == "consistent"
    for triad in ("accel", "gyro"):  # 12 values, of which one in 16000 is beyond four sigma
        assert np.abs(plain[triad]).max() < 4.0
