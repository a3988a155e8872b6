"""EuRoC folders, and imucal's Ferraris sessions: read, calibrated, compared with imucal itself."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap, Layout, read_recordings
from inertiax.data.formats.columns import TimeColumn
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.manual_turns import ANGLE_UNCERTAINTY
from readers_cases import campaign, made_up, refusal
from readers_data import ACCEL, BIAS_A, BIAS_G, D, EUROC, euroc, GYRO, RATE, SECTIONS, session


# EuRoC -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("named", ["mav0/imu0/data.csv", "mav0/imu0", "mav0", "seq"])
def test_euroc_is_read_by_file_or_folder_without_a_column_map(tmp_path, named):
    data = made_up()
    home = tmp_path / "seq" if named == "seq" else tmp_path
    euroc(home / "mav0" / "imu0", data)
    (recording,) = campaign(tmp_path, [named])
    np.testing.assert_array_equal(recording.gyro, data["gyro"])
    np.testing.assert_array_equal(recording.accel, data["accel"])
    # Doubles near 1.4e9 s are 2.4e-7 s apart.
    np.testing.assert_allclose(recording.time, 1403636579 + data["time"], atol=3e-7, rtol=0)


def test_bad_euroc_folders_are_refused_in_one_line(tmp_path):
    (tmp_path / "mav0" / "imu0").mkdir(parents=True)
    (tmp_path / "mav0" / "imu0" / "data.csv").write_text("a,b\n1,2\n")
    assert "is a folder; a recording file is needed" in refusal(read_recordings, tmp_path / "mav0")
    assert "'mav0' does not exist in the campaign's folder" in refusal(campaign, tmp_path, ["mav0"])
    cut = EUROC + "1403636579758555392,-0.0991,0.1473,0.0279,8.1764,-0.4413\n"
    (tmp_path / "mav0" / "imu0" / "data.csv").write_text(cut)
    assert "mav0/mav0" not in refusal(read_recordings, tmp_path / "mav0")
    backward = EUROC + "20,0,0,0,0,0,9.8\n10,0,0,0,0,0,9.8\n"
    (tmp_path / "mav0" / "imu0" / "data.csv").write_text(backward)
    message = refusal(read_recordings, tmp_path / "mav0")
    assert message.startswith("mav0/imu0/data.csv: time must increase strictly")


# imucal ------------------------------------------------------------------------------------------


def toml(folder, file, *, rate=RATE, gravity=9.81, extra="", model="g_sensitivity = true"):
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {gravity}\n[recordings]\nfiles = ["{file}"]\nformat = "imucal"\n'
        f"{extra}\n[columns]\ntime = {{ rate = {rate} }}\n[model]\n{model}\n"
    )
    return load_campaign(folder)


def test_a_session_becomes_one_recording_per_section_with_its_reference(tmp_path):
    session(tmp_path)
    found = toml(tmp_path, "a.csv").recordings
    assert [r.name for r in found] == [f"a.csv ({s})" for s in SECTIONS]
    np.testing.assert_array_equal(found[3].reference_accel[0], [0, -9.81, 0])
    np.testing.assert_array_equal(found[3].reference_gyro, 0)
    assert [r.position[0] for r in found] == [0, 1, 2, 3, 4, 5, -1, -1, -1]
    # -360 degrees in 3 s
    np.testing.assert_allclose(np.rad2deg(found[7].reference_gyro[0]), [0, -120, 0], rtol=1e-12)


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("quiet")
    session(folder, noise=1e-4)
    (result,) = calibrate(toml(folder, "a.csv"))
    return folder, result.calibration


@pytest.mark.slow
def test_known_parameters_come_back_from_a_session(quiet):
    _, found = quiet
    accel, gyro = found.accel_errors(20.0), found.gyro_errors(20.0)
    # Means of 300 samples of noise 1e-4: 6e-6 each, over 9.81 m/s² or 120 deg/s for the matrices.
    np.testing.assert_allclose(accel.bias, BIAS_A, atol=2.5e-5)
    np.testing.assert_allclose(accel.matrix, ACCEL - np.eye(3), atol=2.5e-6)
    np.testing.assert_allclose(np.rad2deg(gyro.bias), BIAS_G, atol=2.5e-5)
    np.testing.assert_allclose(gyro.matrix, GYRO - np.eye(3), atol=3e-7)
    np.testing.assert_allclose(np.rad2deg(np.asarray(gyro.g_sensitivity)) / 9.81, D, atol=3e-6)
    # A turn by hand is known to a degree, and says so.
    sigma = found.gyro.standard_deviations(20.0)
    for k in range(3):
        stated = float(sigma[found.gyro.names.index(f"gyro.matrix[{k},{k}]")])
        assert stated == pytest.approx(ANGLE_UNCERTAINTY / (2 * np.pi), rel=0.05)


def test_turns_of_another_angle_have_their_reference_and_covariance(tmp_path):
    session(tmp_path, noise=1e-3, angle=720.0)
    dwells = reduce_to_dwells(toml(tmp_path, "a.csv", extra="turn_angle = 720").recordings)
    np.testing.assert_allclose(np.rad2deg(dwells.reference_gyro[8]), [0, 0, 240.0], rtol=1e-12)
    expected = [(GYRO @ axis) * 240.0 + BIAS_G + 9.81 * D @ axis for axis in np.eye(3)]
    np.testing.assert_allclose(np.rad2deg(dwells.gyro[6:]), expected, atol=2.5e-4)
    # 1° in 3 s; the noise adds a millionth of that.
    sigma = np.sqrt(np.diagonal(dwells.gyro_covariance[6:], axis1=1, axis2=2))
    np.testing.assert_allclose(sigma, ANGLE_UNCERTAINTY / 3.0, rtol=1e-3)


def test_a_rate_tables_plateau_is_no_turn_by_hand(tmp_path):
    """A steady rate keeps the covariance of its own noise, and so does a slow one of a noisy gyro."""
    rng = np.random.default_rng(2)
    count, noise = 400, 2e-3
    columns = {"time": np.arange(3 * count) / 100.0}
    rates = np.repeat([0.0, 0.5, 0.004], count)
    gyro = noise * rng.standard_normal((3 * count, 3))
    gyro[:, 2] += rates
    from inertiax.data.recording import Recording

    recording = Recording(
        **columns,
        gyro=gyro,
        position=np.repeat([0, -1, -1], count),
        reference_gyro=np.column_stack([0 * rates, 0 * rates, rates]),
    )
    covariance = np.asarray(reduce_to_dwells([recording]).gyro_covariance)
    expected = noise**2 / count
    for dwell in covariance:
        # A variance from 400 samples is known to 7 %; three axes and pooling keep it within 40 %.
        np.testing.assert_allclose(np.diag(dwell), expected, rtol=0.4)


def test_bad_sessions_are_refused_in_one_line(tmp_path):
    session(tmp_path)
    columns = ColumnMap(time=TimeColumn(rate=RATE))
    path, listed = tmp_path / "a.csv", tmp_path / "a_list.json"
    say = lambda columns=columns, **k: refusal(
        read_recordings, path, columns, Layout(**k), name="imucal"
    )
    assert "give the sampling rate with [columns] time" in say(ColumnMap())
    assert "'no.json' does not exist" in say(sections="no.json")
    whole = json.loads(listed.read_text())
    listed.write_text(json.dumps({k: v for k, v in whole.items() if k != "y_rot"}))
    assert "missing ['y_rot'], unknown []" in say()
    listed.write_text(json.dumps(whole | {"x_a": {"start": 10, "end": 10**6}}))
    assert "section x_a is rows 10 to 1000000, but the session has 2880 rows" in say()
    listed.write_text("[1, 2]")
    assert "a list of sections is" in say()
    listed.unlink()
    assert "no list of sections beside it" in say()


def test_sections_may_be_listed_in_a_csv(tmp_path):
    session(tmp_path)
    listed = json.loads((tmp_path / "a_list.json").read_text())
    lines = ["label,start,end"] + [f"{k},{v['start']},{v['end']}" for k, v in listed.items()]
    (tmp_path / "s.csv").write_text("\n".join(lines) + "\n")
    found = toml(tmp_path, "a.csv", extra='sections = "s.csv"').recordings
    assert [r.num_samples for r in found] == [300] * 9


def imucal_result(folder, name, rate):
    imucal = pytest.importorskip("imucal", reason="imucal is not installed")
    import pandas as pd

    data = pd.read_csv(folder / f"{name}.csv", index_col=0)
    sections = pd.DataFrame(json.loads((folder / f"{name}_list.json").read_text())).T
    regions = imucal.ferraris_regions_from_section_list(data, sections)
    return imucal.FerrarisCalibration(grav=9.81).compute(
        regions, rate, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
    )


@pytest.mark.slow
def test_a_quiet_session_gives_imucals_answer(quiet):
    folder, found = quiet
    theirs = imucal_result(folder, "a", RATE)
    gyro = found.gyro_errors(20.0)
    # The equations are the same but for the weights of the rests, whose means are good to 6e-6 deg/s.
    np.testing.assert_allclose(np.rad2deg(gyro.bias), theirs.b_g, atol=2e-5)
    np.testing.assert_allclose(np.eye(3) + gyro.matrix, theirs.K_g @ theirs.R_g, atol=1e-6)
    d = np.rad2deg(np.asarray(gyro.g_sensitivity)) / 9.81
    np.testing.assert_allclose(d, theirs.K_ga, atol=2e-6)


@pytest.fixture(scope="module")
def ferraris(tmp_path_factory):
    home = os.environ.get("INERTIAX_RECORDINGS")
    folder = Path(home or ".") / "imucal-ferraris"
    if home is None or not folder.is_dir():
        pytest.skip("INERTIAX_RECORDINGS does not lead to the recording imucal-ferraris")
    rate = 102.4  # Hz, as imucal's own example has it
    where = tmp_path_factory.mktemp("ferraris")
    file = (folder / "example_ferraris_session.csv").resolve()
    (result,) = calibrate(toml(where, str(file), rate=rate))
    return result, imucal_result(folder, "example_ferraris_session", rate)


@pytest.mark.slow
def test_gyros_of_the_ferraris_recording_agree_with_imucal(ferraris):
    result, theirs = ferraris
    gyro = result.calibration.gyro_errors(20.0)
    sigma = dict(
        zip(result.calibration.gyro.names, result.calibration.gyro.standard_deviations(20.0))
    )
    # Both are the same equations but for the weights of the rests, so well within their noise.
    ours = np.eye(3) + np.asarray(gyro.matrix)
    assert np.abs(ours - theirs.K_g @ theirs.R_g).max() < 1e-5
    for k in range(3):
        difference = float(gyro.bias[k]) - np.deg2rad(theirs.b_g[k])
        assert abs(difference) < float(sigma[f"gyro.bias[{k}]"])
        for j in range(3):
            difference = float(gyro.g_sensitivity[k, j]) - 9.81 * np.deg2rad(theirs.K_ga[k, j])
            assert abs(difference) < 3 * float(sigma[f"gyro.g_sensitivity[{k},{j}]"])
        # The turns' angle is known to 1° of 360°.
        assert float(sigma[f"gyro.matrix[{k},{k}]"]) == pytest.approx(1 / 360, rel=0.02)


def test_accelerometers_of_the_ferraris_recording_agree_with_imucal(ferraris):
    result, theirs = ferraris
    accel = result.calibration.accel_errors(20.0)
    scatter = result.accel.scatter  # m/s² between poses: how well a hand places the housing
    # imucal takes each bias from two poses and each column of the matrix from two; ours is least
    # squares over all. With the same data the difference has less than imucal's own variance.
    assert np.abs(np.asarray(accel.bias) - theirs.b_a).max() < 3 * scatter / np.sqrt(2)
    matrix = np.eye(3) + np.asarray(accel.matrix) - theirs.K_a @ theirs.R_a
    assert np.abs(matrix).max() < 3 * scatter / np.sqrt(2) / 9.81
    assert 0.003 < scatter < 0.05
