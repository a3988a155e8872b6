"""A campaign file becomes a `Campaign` in SI, with notes on what looks odd."""

# Columns are optional in the types, and these recordings have them:
# pyright: reportOptionalSubscript=false, reportOptionalMemberAccess=false
# pyright: reportOptionalOperand=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false

import math
import os
from pathlib import Path

import numpy as np
import pytest

from inertiax.data.campaign import find_files, load_campaign
from inertiax.data.recording import Recording
from inertiax.data.recording_order import in_order
from inertiax.plausibility import check_campaign
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.rests import find_rests
from inertiax.reduction.segments import segment


REAL = os.environ.get("INERTIAX_RECORDINGS")
needs_recordings = pytest.mark.skipif(
    REAL is None, reason="INERTIAX_RECORDINGS does not point at the real recordings"
)

FULL = """
[site]
gravity = 9.815179
latitude = 55.57

[recordings]
files = ["*.csv"]

[columns]
time = { name = "t", unit = "ms" }
accel = { names = ["ax", "ay", "az"], unit = "g" }
gyro = { names = ["wx", "wy", "wz"], unit = "deg/s" }
temperature = { name = "temp", unit = "degC" }

[rig]
position_uncertainty = 2.0
rate_uncertainty = 5.0
temperature_uncertainty = 0.05

[device]
grade = "navigation"

[model]
accel_estimator = "invariant"
gyro_estimator = "static"
g_sensitivity = false
temperature_degree = 3
"""
ROWS = "t,ax,ay,az,wx,wy,wz,temp\n" + "".join(
    f"{10 * i},0.0,0.1,1.00{i % 2},0.5,-0.5,0.2{i % 2},{20 + i}\n" for i in range(20)
)


def _write(folder, toml, **files):
    (folder / "campaign.toml").write_text(toml, "utf-8")
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return folder


def test_everything_in_the_file_arrives_in_si(tmp_path):
    c = load_campaign(_write(tmp_path, FULL, a=ROWS))
    assert c.site.gravity == 9.815179
    assert c.site.latitude == pytest.approx(0.9698794, abs=1e-7)  # 55.57 deg
    assert c.rig.position_uncertainty == pytest.approx(9.696274e-6, rel=1e-6)  # 2 arcsec
    assert c.rig.rate_uncertainty == pytest.approx(5e-6)
    assert c.rig.temperature_uncertainty == 0.05
    assert c.grade == "navigation"
    assert c.model.accel_estimator == "invariant" and c.model.gyro_estimator == "static"
    assert c.model.g_sensitivity is False and c.model.temperature_degree == 3
    assert c.path == tmp_path / "campaign.toml"
    (r,) = c.recordings
    np.testing.assert_allclose(r.time[:3], [0, 0.01, 0.02], rtol=1e-15)
    np.testing.assert_allclose(r.accel[0], [0, 0.980665, 9.80665], rtol=1e-15)
    np.testing.assert_allclose(r.gyro[0], np.radians([0.5, -0.5, 0.2]), rtol=1e-14)
    assert r.temperature[3, 0] == 23.0
    assert c.notes == ()


def test_the_folder_and_the_file_are_the_same_campaign(tmp_path):
    _write(tmp_path, FULL, a=ROWS)
    by_file = load_campaign(str(tmp_path / "campaign.toml"))
    np.testing.assert_array_equal(
        by_file.recordings[0].accel, load_campaign(tmp_path).recordings[0].accel
    )


def test_absent_tables_leave_the_choice_to_the_tool(tmp_path):
    toml = '[site]\ngravity = 9.81\n[recordings]\nfiles = ["a.csv"]\n'
    rows = "time,accel_x,accel_y,accel_z\n0,0,0,9.8\n1,0,0,9.8\n"
    c = load_campaign(_write(tmp_path, toml, a=rows))
    assert c.model.accel_estimator is None and c.model.temperature_degree is None
    assert c.rig.position_uncertainty is None and c.grade is None and c.site.latitude is None


def test_files_are_in_natural_order_and_each_once(tmp_path):
    for name in ("log10.csv", "log2.csv", "log1.csv", ".hidden.csv"):
        (tmp_path / name).write_text("x")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "log0.csv").write_text("x")
    names = lambda *patterns: [str(p.relative_to(tmp_path)) for p in find_files(tmp_path, patterns)]
    assert names("*.csv") == ["log1.csv", "log2.csv", "log10.csv"]
    assert names("log2.csv", "*.csv") == ["log2.csv", "log1.csv", "log10.csv"]
    assert names("**/*.csv") == ["inner/log0.csv", "log1.csv", "log2.csv", "log10.csv"]


def test_two_files_of_one_triad_each_are_one_recording(tmp_path):
    toml = (
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["acc*.csv"]\ngyro_files = ["gyr*.csv"]\n'
        '[columns]\naccel = { names = ["x", "y", "z"] }\ngyro = { names = ["x", "y", "z"] }\n'
    )
    accel = "time,x,y,z\n0,0,0,9.8\n1,0,0,9.9\n"
    gyro = "time,x,y,z\n0,1,2,3\n1,4,5,6\n"
    c = load_campaign(_write(tmp_path, toml, acc1=accel, acc2=accel, gyr1=gyro, gyr2=gyro))
    assert [r.name for r in c.recordings] == ["acc1.csv + gyr1.csv", "acc2.csv + gyr2.csv"]
    np.testing.assert_array_equal(c.recordings[0].gyro, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(c.recordings[0].accel[:, 2], [9.8, 9.9])


# --- notes ---------------------------------------------------------------------------------------

PLAIN = '[site]\ngravity = 9.81\n[recordings]\nfiles = ["a.csv"]\n'


def _notes(tmp_path, time, accel):
    rows = np.column_stack([time, accel])
    text = "time,accel_x,accel_y,accel_z\n" + "\n".join(
        ",".join(map(repr, r)) for r in rows.tolist()
    )
    found = check_campaign(load_campaign(_write(tmp_path, PLAIN, a=text))).findings
    # `_tumble` never lies still, which is said of it and of nothing else here.
    return tuple(f.statement for f in found if f.kind != "no_rest")


def _tumble(count=4000, noise=0.02):
    rng = np.random.default_rng(1)
    t = np.arange(count) / 100
    accel = 9.81 * np.stack(
        [np.sin(t), np.cos(t) * np.sin(0.3 * t), np.cos(t) * np.cos(0.3 * t)], 1
    )
    return t, accel + noise * rng.standard_normal(accel.shape)


def test_a_sound_recording_has_no_notes(tmp_path):
    assert _notes(tmp_path, *_tumble()) == ()


def test_a_coarse_converter_at_rest_is_not_called_saturated(tmp_path):
    t = np.arange(3000) / 100
    pose = np.repeat([0.0, 9.8, -9.8], 1000)
    rng = np.random.default_rng(2)
    accel = np.stack([pose, 0.02 * pose, 9.8 - np.abs(pose)], axis=1)
    accel += 0.005 * rng.standard_normal((3000, 3))
    coarse = np.round(accel / 0.05) * 0.05
    assert _notes(tmp_path, t, coarse) == ()
    rests = find_rests(Recording(time=t, accel=coarse), window=1.0)  # constant within each
    assert len(rests.start) == 3


def test_saturation_names_channel_value_and_count(tmp_path):
    t, accel = _tumble()
    accel[:, 1] = np.clip(accel[:, 1], -9.0, 8.0)
    at_end = int((accel[:, 1] == 8.0).sum())
    notes = _notes(tmp_path, t, accel)
    assert (
        f"a.csv: accel_y looks saturated at 8 m/s² ({at_end} samples at exactly this extreme value, "
        "0 of them at rest)."  # it tumbles slowly all along
    ) in notes
    assert len(notes) == 2  # and at -9


def test_a_gap_in_time_is_noted_with_its_place(tmp_path):
    t, accel = _tumble()
    t[2000:] += 7.0
    assert _notes(tmp_path, t, accel) == (
        "a.csv: 1 gap(s) in time of more than 20 usual steps (0.01 s); the longest is 7.01 s after "
        "row 1999 (19.99 s).",
    )


def test_a_dead_channel_is_noted(tmp_path):
    t, accel = _tumble()
    accel[:, 0] = 0.25
    assert _notes(tmp_path, t, accel) == (
        "a.csv: accel_x never changes (0.25); the channel looks dead, or at the end of its range. Mend it, or "
        "calibrate without this triad: "
        '[model] accel_estimator = "none".',
    )


def test_a_doubtful_time_unit_is_noted(tmp_path):
    t, accel = _tumble()
    assert (
        "the usual step in time is 1e+04 s; likely microseconds"
        in _notes(tmp_path, t * 1e6, accel)[0]
    )


@pytest.mark.parametrize(
    ("start", "said"),
    [(7, "a.csv and b.csv overlap in time"), (0, "the clocks of a.csv and the others begin at 0")],
)
def test_recordings_that_overlap_in_time_are_noted(tmp_path, start, said):
    rows = f"time,accel_x,accel_y,accel_z\n{start},0,0,9.8\n{start + 1},0,0,9.8\n"
    c = load_campaign(_write(tmp_path, PLAIN.replace("a.csv", "*.csv"), a=rows, b=rows))
    (found,) = check_campaign(c).findings
    assert found.severity == "note" and found.statement == (
        f"{said}: recordings are taken one after the other as they are listed, and a drift "
        "over the campaign is judged in that order."
    )


@pytest.mark.parametrize(
    ("starts", "order"), [((0.003, 0.0), (0, 1)), ((60.0, 0.0), (1, 0))], ids=["overlap", "apart"]
)
def test_recordings_stand_as_listed_where_clocks_overlap_and_by_time_elsewhere(starts, order):
    listed = [Recording(time=start + np.arange(30.0), accel=np.ones((30, 3))) for start in starts]
    assert [r.time[0] for r in in_order(listed)] == [starts[k] for k in order]


# --- real recordings -----------------------------------------------------------------------------

XSENS = """
[site]
gravity = 9.81744

[recordings]
files = ["{folder}/xsens_acc.mat"]
gyro_files = ["{folder}/xsens_gyro.mat"]

[columns]
accel = {{ unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2" }}
gyro = {{ unit = "count", offset = 32768, scale = [4778, 4758, 4766], scale_unit = "count per rad/s" }}
"""


@needs_recordings
def test_xsens_raw_counts_from_two_text_files(tmp_path):
    folder = Path(str(REAL)) / "imu_tk-xsens"
    c = load_campaign(_write(tmp_path, XSENS.format(folder=folder)))
    (r,) = c.recordings
    assert r.num_samples == 51175 and r.accel is not None and r.gyro is not None
    np.testing.assert_allclose(r.accel[0], [340 / 415, 561 / 413, 3661 / 415], rtol=1e-12)
    assert abs(segment(r).num_segments - 38) <= 2
    d = reduce_to_dwells(c.recordings)
    norms = np.linalg.norm(d.accel, axis=1)
    # The true offsets are 356, 507 and -404 counts from the nominal one, 1.23 m/s² at most.
    assert np.all(np.abs(norms / 9.81744 - 1) < 0.17)


@needs_recordings
def test_a_single_pose_over_temperature_is_cut_into_blocks(tmp_path):
    file = Path(str(REAL)) / "tofupilot-thermal/imu_raw_data.csv"
    toml = f"""
[site]
gravity = 9.81
[recordings]
files = ["{file}"]
start_row = 5
[columns]
time = {{ rate = 1.0 }}
accel = {{ names = ["imu.acc.x", "imu.acc.y", "imu.acc.z"] }}
gyro = {{ names = ["imu.gyro.x", "imu.gyro.y", "imu.gyro.z"] }}
temperature = "imu.temperature"
"""
    c = load_campaign(_write(tmp_path, toml))
    d = reduce_to_dwells(c.recordings)
    assert len(np.unique(d.position)) == 1
    assert 240 < d.num_dwells < 700  # some 200 °C down and up; equal blocks, 1 °C in the steepest
    assert d.temperature.min() < -17 and d.temperature.max() > 73


@needs_recordings
def test_a_labelled_session_in_other_units(tmp_path):
    file = Path(str(REAL)) / "imucal-ferraris/example_ferraris_session.csv"
    toml = f"""
[site]
gravity = 9.81
[recordings]
files = ["{file}"]
[columns]
time = {{ rate = 204.8 }}
accel = {{ names = ["acc_x", "acc_y", "acc_z"] }}
gyro = {{ names = ["gyr_x", "gyr_y", "gyr_z"], unit = "deg/s" }}
"""
    c = load_campaign(_write(tmp_path, toml))
    (r,) = c.recordings
    assert r.gyro[0, 0] == pytest.approx(math.radians(-0.6103515625))
    d = reduce_to_dwells(c.recordings)
    # The six poses are among the rests: every axis sees both signs of gravity.
    for axis in range(3):
        assert d.accel[:, axis].max() > 9 and d.accel[:, axis].min() < -9
