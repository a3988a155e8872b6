"""One accelerometer axis in another unit is called so, with the line that mends it."""

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from hand_log_data import G, hand_log
from inertiax.calibrate.goodness_of_fit import matrix_mistakes
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log(rests=16)


def written(folder, accel, columns="", reference=None):
    table = {"time": TIME[: len(accel)]}
    table |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    table |= {f"gyro_{a}": GYRO[: len(accel), k] for k, a in enumerate("xyz")}
    if reference is not None:
        table |= {f"reference_accel_{a}": reference[:, k] for k, a in enumerate("xyz")}
        table["position"] = np.repeat(np.arange(len(reference) // 50), 50)
    pl.DataFrame(table).write_csv(folder / "log.csv")
    toml = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n'
    (folder / "campaign.toml").write_text(toml + columns)
    return load_campaign(folder), toml


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("unit, si", [("g", G), ("mg", G / 1000.0)])
def test_the_unit_is_told_and_the_remedy_mends_it(tmp_path, axis, unit, si):
    mixed = ACCEL.copy()
    mixed[:, axis] /= si
    campaign, toml = written(tmp_path, mixed)
    found = check_campaign(campaign).findings[0]
    assert (found.kind, found.severity) == ("accel_unit", "error")
    assert f"accel_{'xyz'[axis]} reads" in found.statement
    assert f'that axis is in another unit; likely in "{unit}"' in found.statement
    (tmp_path / "campaign.toml").write_text(toml + found.remedy)
    mended = load_campaign(tmp_path)
    np.testing.assert_allclose(mended.recordings[0].accel, ACCEL, rtol=1e-9, atol=1e-12)
    assert check_campaign(mended).verdict == "plausible"


def test_counts_of_another_range_keep_their_scale(tmp_path):
    """One axis of a converter at half the range: twice the counts."""
    counts = np.round(ACCEL / G * 4096.0)
    counts[:, 2] *= 2.0
    columns = '[columns]\naccel = { unit = "count", scale = 4096, scale_unit = "count per g" }\n'
    campaign, toml = written(tmp_path, counts, columns)
    found = check_campaign(campaign).findings[0]
    assert "accel_z reads 2" in found.statement
    (tmp_path / "campaign.toml").write_text(toml + found.remedy)
    np.testing.assert_allclose(
        load_campaign(tmp_path).recordings[0].accel, ACCEL, rtol=0.02, atol=0.01
    )


def test_by_a_reference_few_rests_are_enough(tmp_path):
    up = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
    ideal = np.repeat(G * up, 50, axis=0)
    output = ideal.copy()
    output[:, 0] /= G
    output += 0.001 * np.random.default_rng(0).standard_normal(output.shape)
    campaign, _ = written(tmp_path, output, reference=ideal)
    assert (
        "accel_x reads 0.102 times what y and z read"
        in check_campaign(campaign).findings[0].statement
    )


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (9.8, 9.8, 9.8), (1.15, 0.9, 1.0)])
def test_one_unit_for_all_and_raw_scales_are_no_other_unit(scale):
    recording = Recording(time=TIME, accel=ACCEL * scale, gyro=GYRO)
    said = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    assert not [f for f in said if "that axis is in another unit" in f.statement]


def test_directions_in_a_plane_tell_no_unit_of_the_third_axis():
    """A tumble about z: |a| says nothing of z."""
    up = Rotation.from_rotvec([[0, 0, k] for k in np.arange(0, 6.2, 0.3)]).apply([1.0, 0, 0])
    accel = np.repeat(G * up, 100, axis=0)
    accel += 0.01 * np.random.default_rng(1).standard_normal(accel.shape)
    recording = Recording(
        time=np.arange(len(accel)) / 50.0, accel=accel, position=np.repeat(np.arange(len(up)), 100)
    )
    said = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    assert not [f for f in said if "that axis is in another unit" in f.statement]


def test_a_fit_s_sign_is_called_wrong_where_it_alone_is():
    names = tuple(f"accel.matrix[{i},{j}]" for i in range(3) for j in range(3))
    mistakes = lambda y: matrix_mistakes(
        names, np.diag([0.0, y - 1.0, 0.0]).ravel(), np.full(9, 1e-3)
    )
    assert mistakes(-1.01) == [("sign", "axis y has the wrong sign.")]
    for size in (102.0, 0.102):
        text = f"axis y reads {size:.3g} times the truth; look at unit and range."
        assert mistakes(size) == mistakes(-size) == [("unit", text)]


def test_a_reference_in_other_axes_is_no_unit_of_one_axis(tmp_path):
    """North, east, down beside east, north, up: x and y hardly go with their references, and z goes against its own."""
    rng = np.random.default_rng(1)
    up = np.vstack([np.eye(3), -np.eye(3), [[1, 1, 0], [1, 1, 1], [1, 1, -1], [-1, 1, 1]]])
    up = up / np.linalg.norm(up, axis=1)[:, None]
    ideal = np.repeat(G * up, 50, axis=0)
    output = ideal[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    output = output + 0.001 * rng.standard_normal(output.shape)
    campaign, toml = written(tmp_path, output, reference=ideal)
    found = check_campaign(campaign).findings
    assert [f.kind for f in found if f.severity == "error"] == ["axes"]
    assert "x and y are exchanged and z is mirrored" in found[0].statement
