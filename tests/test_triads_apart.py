"""Triads that were logged apart, each with stamps of its own, become one recording."""

# pyright: reportOptionalSubscript=false

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.allan import noise_of_triads
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate
from inertiax.calibration.calibration import Calibration
from inertiax.data.campaign import load_campaign, load_triads_apart
from inertiax.data.pairing import pair
from inertiax.data.recording import Recording
from inertiax.exports.compensated_recording import compensate_file
from inertiax.report.calibration import _verdict
from inertiax.report.text import print_result


RATE, SLOPE = np.array([0.3, -0.2, 0.1]), np.array([0.05, 0.02, -0.07])


def triads(accel_time, gyro_time):
    """Gyros that follow straight lines, accelerometers that stay: interpolation is exact for both."""
    accel = Recording(
        time=accel_time, accel=np.tile([0.1, 0.2, 9.8], (len(accel_time), 1)), name="a"
    )
    gyro = Recording(time=gyro_time, gyro=RATE + SLOPE * gyro_time[:, None], name="g")
    return accel, gyro


def test_the_sparser_triad_is_put_onto_the_stamps_of_the_other():
    accel, gyro = triads(np.arange(0.0, 10.0, 0.011), np.arange(0.7, 9.0, 0.0093))
    paired = pair(accel, gyro)
    found = paired.recording
    # The gyros are quicker, so their stamps stay; both cover 0.7 s to 9 s.
    np.testing.assert_array_equal(found.time, gyro.time)
    np.testing.assert_array_equal(found.gyro, gyro.gyro)
    np.testing.assert_allclose(
        found.accel, np.tile([0.1, 0.2, 9.8], (len(gyro.time), 1)), rtol=1e-14
    )
    assert "accelerometers are put onto" in paired.note and "5.5 ms" in paired.note


def test_slower_gyros_are_put_onto_the_accelerometers_stamps():
    accel, gyro = triads(np.arange(0.0, 10.0, 0.005), np.arange(0.7, 9.0, 0.0093))
    found = pair(accel, gyro).recording
    np.testing.assert_array_equal(
        found.time, accel.time[(accel.time >= 0.7) & (accel.time <= gyro.time[-1])]
    )
    np.testing.assert_allclose(found.gyro, RATE + SLOPE * found.time[:, None], rtol=1e-12)


def test_no_samples_are_made_up_over_a_gap():
    accel, gyro = triads(np.arange(0.0, 10.0, 0.005), np.arange(0.0, 10.0, 0.01))
    gyro = gyro[(gyro.time <= 3.0) | (gyro.time > 4.0)]
    found = pair(accel, gyro).recording
    last = gyro.time[gyro.time <= 3.0][-1]
    assert not np.any((found.time > last) & (found.time < 4.0))
    assert found.num_samples > 1700


def test_stamps_that_agree_are_left_as_they_are():
    time = np.arange(0.0, 5.0, 0.01)
    accel, gyro = triads(time, time + 1e-4)
    paired = pair(accel, gyro)
    np.testing.assert_array_equal(paired.recording.gyro, gyro.gyro)
    assert paired.note is None


def test_labels_of_one_file_are_held_and_temperature_follows_lines():
    accel, gyro = triads(np.arange(0.0, 10.0, 0.01), np.arange(0.0, 10.0, 0.005))
    accel = Recording(
        time=accel.time,
        accel=accel.accel,
        temperature=(20 + accel.time)[:, None],
        position=(accel.time >= 5).astype(np.int64),
        name="a",
    )
    found = pair(accel, gyro).recording
    np.testing.assert_allclose(found.temperature[:, 0], 20 + found.time, rtol=1e-12)
    np.testing.assert_array_equal(found.position, found.time >= 5)


def test_a_campaign_reads_phones_files_of_different_width(tmp_path):
    accel, gyro = triads(np.arange(0.0, 10.0, 0.011), np.arange(0.7, 9.0, 0.0093))
    text = lambda t, x: "".join(
        " ".join(map(repr, row)) + "\n" for row in np.column_stack([t, *x]).tolist()
    )
    (tmp_path / "accelerometer.txt").write_text(text(accel.time, [accel.accel]))
    # Android appends the bias that it would subtract.
    (tmp_path / "gyroscope.txt").write_text(text(gyro.time, [gyro.gyro, 0 * gyro.gyro]))
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.80665\n[recordings]\nfiles = ["accelerometer.txt"]\n'
        'gyro_files = ["gyroscope.txt"]\nnames = ["t", "x", "y", "z"]\n'
        'gyro_names = ["t", "x", "y", "z", "bx", "by", "bz"]\n[columns]\ntime = { name = "t" }\n'
        'accel = { names = ["x", "y", "z"] }\ngyro = { names = ["x", "y", "z"] }\n'
    )
    campaign = load_campaign(tmp_path)
    np.testing.assert_array_equal(campaign.recordings[0].gyro, gyro.gyro)
    assert campaign.notes[0].startswith("accelerometer.txt + gyroscope.txt: the triads have stamps")


def test_one_triad_s_file_is_not_taken_for_both(tmp_path):
    """`x, y, z` are accelerometers in one file and gyros in the other: of one alone, rates would be accelerations."""
    (tmp_path / "accel.csv").write_text(
        "time,x,y,z\n" + "".join(f"{k},0,0,9.8\n" for k in range(9))
    )
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.80665\n[recordings]\nfiles = ["accel.csv"]\ngyro_files = ["gyro.csv"]\n'
        '[columns]\naccel = { names = ["x", "y", "z"] }\ngyro = { names = ["x", "y", "z"] }\n'
    )
    with pytest.raises(ValueError, match="accel.csv: the columns x, y, z .* by --gyro FILE"):
        compensate_file(Calibration(9.80665), tmp_path / "accel.csv", campaign=tmp_path)


def test_the_noise_of_triads_apart_is_that_of_their_own_samples(tmp_path):
    """White noise of 0.01 rad/s, on stamps 3 ms of 10 ms behind the accelerometers': straight lines would leave
    √(0.7² + 0.3²) = 0.76 of it."""
    rng, time = np.random.default_rng(5), np.arange(12000) / 100.0
    for triad, stamps, values in (
        ("accel", time, [0.0, 0.0, 9.8] + 0.02 * rng.normal(size=(len(time), 3))),
        ("gyro", time[:-2] + 0.003, 0.01 * rng.normal(size=(len(time) - 2, 3))),
    ):
        rows = np.column_stack([stamps, values])
        np.savetxt(tmp_path / f"{triad}.csv", rows, "%.9g", ",", header="time,x,y,z", comments="")
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.8\n[recordings]\nfiles = ["accel.csv"]\ngyro_files = ["gyro.csv"]\n'
        '[columns]\naccel = { names = ["x", "y", "z"] }\ngyro = { names = ["x", "y", "z"] }\n'
    )
    ((accel, gyro),) = load_triads_apart(tmp_path)
    found = {c.channel: c for c in noise_of_triads(accel, gyro).channels}
    for triad, sigma in (("accel", 0.02), ("gyro", 0.01)):
        for axis in "xyz":
            # Of 12000 samples a standard deviation is known to 0.65 %, and N from them to about twice that.
            channel = found[f"{triad}_{axis}"]
            assert channel.sample == pytest.approx(sigma, rel=4 * 0.0065)
            assert channel.model.discrete_sigma == pytest.approx(sigma, rel=4 * 0.013)
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.8\n[recordings]\nfiles = ["accel.csv"]\n'
    )
    assert load_triads_apart(tmp_path) == ()


def test_counted_rows_must_agree():
    accel, gyro = triads(np.arange(10) / 10, np.arange(9) / 10)
    with pytest.raises(ValueError, match="10 and 9 rows"):
        pair(accel, gyro, counted=True)


GYRO_ERRORS = np.array([[0.004, -0.002, 0.003], [0.001, -0.005, 0.002], [-0.003, 0.002, 0.006]])


def by_hand(folder, behind):
    """Twenty poses of 4 s, a turn of 1.5 s between two of them, at 200 Hz with stamps that jitter by 0.1 ms; the gyros'
    stamps are `behind` s late, in a file of their own and beside that in one file with the accelerometers'."""
    rng, step, pose, turn = np.random.default_rng(8), 1e-3, 4.0, 1.5
    attitudes = Rotation.random(20, random_state=3)
    time = np.arange(0.0, 20 * (pose + turn) - turn, step)
    number, since = np.divmod(time, pose + turn)
    u = np.clip((since - pose) / turn, 0.0, 1.0)
    now, then = number.astype(int), np.minimum(number.astype(int) + 1, 19)
    way = (attitudes[now].inv() * attitudes[then]).as_rotvec()
    attitude = attitudes[now] * Rotation.from_rotvec(
        (u**3 * (10 - 15 * u + 6 * u**2))[:, None] * way
    )
    rate = np.gradient(u**3 * (10 - 15 * u + 6 * u**2), step)[:, None] * way
    force = attitude.inv().apply([0.0, 0.0, 9.8])
    stamps = np.arange(0.1, time[-1] - 0.2, 0.005)
    stamps = [stamps + late + 1e-4 * rng.normal(size=len(stamps)) for late in (0.0, 0.002)]
    at = lambda x, t: np.stack([np.interp(t, time, c) for c in x.T], axis=1)
    accel = at(force @ np.diag([1.003, 0.998, 1.001]) + [0.2, -0.1, 0.3], stamps[0])
    gyro = at(rate @ (np.eye(3) + GYRO_ERRORS).T + [0.01, -0.02, 0.005], stamps[1])
    accel += 0.01 * rng.normal(size=accel.shape)
    gyro += 1e-3 * rng.normal(size=gyro.shape)
    both = np.stack([np.interp(stamps[0], stamps[1], c) for c in gyro.T], axis=1)
    rows = lambda t, *x: np.column_stack([t, *x])
    write = lambda name, table, head: np.savetxt(
        folder / name, table, "%.9g", ",", header=head, comments=""
    )
    write("accel.csv", rows(stamps[0], accel), "time,x,y,z")
    write("gyro.csv", rows(stamps[1] + behind, gyro), "gyro_time,x,y,z")
    write("both.csv", rows(stamps[0], accel, both), "time,ax,ay,az,gx,gy,gz")
    apart, one = folder / "apart.toml", folder / "one.toml"
    start = "[site]\ngravity = 9.8\n[recordings]\n"
    apart.write_text(
        start + 'files = ["accel.csv"]\ngyro_files = ["gyro.csv"]\n[columns]\n'
        'time = { name = "time", gyro_name = "gyro_time" }\n'
        'accel = { names = ["x", "y", "z"] }\ngyro = { names = ["x", "y", "z"] }\n'
    )
    one.write_text(
        start + 'files = ["both.csv"]\n[columns]\naccel = { names = ["ax", "ay", "az"] }\n'
        'gyro = { names = ["gx", "gy", "gz"] }\n'
    )
    return [calibrate(load_campaign(path))[0] for path in (apart, one)]


@pytest.fixture(scope="module")
def same_log(tmp_path_factory):
    """The results of `by_hand` without a delay."""
    return by_hand(tmp_path_factory.mktemp("log"), behind=0.0)


def of_matrix(result):
    """The gyros' errors of scale and alignment, and their standard deviations."""
    (values,), (sigmas,) = result.calibration.gyro.over(np.zeros(1))
    place = [k for k, n in enumerate(result.calibration.gyro.names) if ".matrix" in n]
    return values[place], sigmas[place]


@pytest.mark.slow
def test_a_log_in_two_files_is_judged_as_the_same_log_in_one(same_log, tmp_path, capsys):
    apart, one = same_log
    assert judge(apart).verdict == judge(one).verdict == "good"
    assert apart.warnings == one.warnings == ()
    (said,) = set(apart.choices) - set(one.choices)
    assert said.startswith("accel.csv + gyro.csv: the triads have stamps of their own")
    for triad in ("accel", "gyro"):
        first, second = getattr(apart, triad), getattr(one, triad)
        assert first.chi2_per_dof == pytest.approx(second.chi2_per_dof, rel=0.02)
    print_result(apart, tmp_path)
    assert (
        " ".join(capsys.readouterr().out.split()).count("the triads have stamps of their own") == 1
    )


def test_a_reservation_is_said_once(same_log, tmp_path, capsys):
    """The answer names the first reservation, the list of warnings the others."""
    result, _ = same_log
    first, second = "accel.csv was compensated before.", "The table's errors are not stated."
    doubted = replace(result, warnings=(first, second))
    quality = judge(doubted)
    assert quality.answer == f"Usable, with a reservation: {first}"
    print_result(doubted, tmp_path)
    printed = " ".join(capsys.readouterr().out.split())
    page = " ".join(_verdict(doubted, quality).lines)
    for said in (printed, page):
        assert said.count(first) == said.count(second) == 1


@pytest.mark.slow
def test_a_delay_between_the_files_does_not_move_what_rests_and_turns_tell(tmp_path):
    """A tenth of a second, twenty samples: the gyros' matrix is the simulated one, as without it."""
    late, _ = by_hand(tmp_path, behind=0.1)
    assert judge(late).verdict == "good"
    values, sigmas = of_matrix(late)
    wrong = (values - GYRO_ERRORS.ravel()) / sigmas
    # Nine parameters: a rms of more than 1.9 or one beyond 4 sigma is rarer than 1e-3 and 1e-3.
    assert np.sqrt(np.mean(wrong**2)) < 1.9 and np.abs(wrong).max() < 4.0
    assert np.all(sigmas < 0.002)
