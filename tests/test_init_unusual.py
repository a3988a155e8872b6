"""`inertiax init` on layouts of public logs that it once read wrongly; the data are the hand log of these tests."""

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from hand_log_data import CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.calibrate.pipeline import calibrate
from inertiax.campaign_draft.accel_unit import lacks_gravity
from inertiax.campaign_draft.gyro_unit import gyro_unit
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()


def test_what_rises_throughout_is_the_clock_and_a_dead_temperature_is_none(tmp_path):
    """As an ESP32 with a weather sensor writes it; the probe beside the IMU is the second temperature."""
    warm = 20.0 + TIME / 60.0
    columns = (1e3 * TIME, ACCEL / G, GYRO / DEGREE, np.zeros_like(warm), warm)
    path = written(tmp_path / "log.csv", columns, f"now[ms],{CANONICAL},BMP_temp[C],gtemp")
    found = draft(path)["columns"]
    assert found["time"] == {"name": "now[ms]", "unit": "ms"}
    assert found["temperature"]["name"] == "gtemp"
    assert "BMP_temp[C]: a further temperature" in (tmp_path / "campaign.toml").read_text()
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.time[-1] - recording.time[0] == pytest.approx(TIME[-1] - TIME[0], rel=1e-5)


def test_empty_fields_at_the_end_of_most_rows(tmp_path):
    """An MTi's export: angles in every fourth row, tabs elsewhere, and a clock of tenths of a millisecond."""
    counter = np.arange(len(TIME))
    lines = [
        "// ProductCode: MTi-300",
        "SampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tRoll\tYaw",
    ]
    for k, a, w in zip(counter, ACCEL, GYRO):
        numbers = [f"{1000 + 100 * k}", *(f"{v:.7g}" for v in (*a, *w))]
        lines.append("\t".join([*numbers, *(["0.1", "0.2"] if k % 4 == 1 else ["", ""])]))
    path = tmp_path / "x_up.txt"
    path.write_text("\n".join(lines) + "\n")
    found = draft(path)
    assert found["columns"]["accel"] == {"names": ["Acc_X", "Acc_Y", "Acc_Z"], "unit": "m/s^2"}
    assert found["columns"]["time"] == {"rate": 100.0}  # 100 tenths of a millisecond a row
    assert load_campaign(tmp_path).recordings[0].num_samples == len(TIME)


@pytest.mark.parametrize(
    ("name", "key"),
    [("meanListAccel.csv", "accel"), ("33RPMgyr.txt", "gyro"), ("HMC5883L_calibr.txt", "mag")],
)
def test_three_columns_without_names_are_what_the_file_is_called(tmp_path, name, key):
    """Numbers of a magnitude that accelerometers (256 per g), gyros and magnetometers (mG) may all have."""
    path = written(tmp_path / name, (ACCEL / np.linalg.norm(ACCEL, axis=1)[:, None] * 250.0,))
    found = draft(path)["columns"]
    assert {"accel", "gyro", "mag"} & set(found) == {key}


def test_a_ros_message_has_its_unit_by_definition(tmp_path):
    """At rest nothing but the field's name tells rad/s from deg/s."""
    rng = np.random.default_rng(0)
    time = np.arange(3000) / 100.0
    accel = np.array([0.0, 0.0, G]) + 0.02 * rng.normal(size=(3000, 3))
    gyro = 0.3 * rng.normal(size=(3000, 3))
    names = [f"imu.{k}.{a}" for k in ("linear_acceleration", "angular_velocity") for a in "xyz"]
    path = written(tmp_path / "imu.csv", (time, accel, gyro), ",".join(["Time", *names]))
    assert draft(path)["columns"]["gyro"]["unit"] == "rad/s"


def test_gyros_beside_it_that_do_not_fit_are_left_alone(tmp_path):
    """Stamps of another name and unit; asked for by name they are an error."""
    path = written(tmp_path / "accel.csv", (TIME, ACCEL), "t_a,x,y,z")
    other = written(tmp_path / "gyro.csv", (1e6 * TIME[1:], GYRO[1:]), "t_g,x,y,z")
    assert "gyro" not in draft(path)["columns"]
    with pytest.raises(ValueError, match=r"gyro\.csv: has no column 't_a'"):
        draft(path, gyro=other)


def test_gyros_beside_it_call_their_stamps_otherwise(tmp_path):
    path = written(tmp_path / "accel.csv", (TIME, ACCEL), "t_a,x,y,z")
    written(tmp_path / "gyro.csv", (TIME[1:], GYRO[1:]), "t_g,x,y,z")
    found = draft(path)["columns"]
    assert found["time"] == {"name": "t_a", "gyro_name": "t_g", "unit": "s"}
    assert found["gyro"]["names"] == ["x", "y", "z"]
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.time, TIME[1:], atol=1e-9)
    np.testing.assert_allclose(recording.gyro, GYRO[1:], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(recording.accel, ACCEL[1:], rtol=1e-5, atol=1e-7)


def test_a_message_printed_field_by_field(tmp_path):
    """As `ros2 topic echo --csv` prints sensor_msgs/Imu: stamps in two columns, an attitude, covariances, no names."""
    stamp = 1_762_184_494.25 + TIME
    whole = np.floor(stamp)
    turn = Rotation.from_rotvec(
        np.column_stack([np.sin(TIME), np.cos(TIME), TIME / 50.0])
    ).as_quat()
    covariance = np.tile([-1.0, *[0.0] * 8], (len(TIME), 1))
    columns = (turn, covariance, GYRO, covariance, ACCEL, covariance)
    path = tmp_path / "imu.csv"
    path.write_text(
        "".join(
            f"{int(s)},{int(1e9 * (t - s))},imu," + ",".join(f"{v:.9g}" for v in row) + "\n"
            for s, t, row in zip(whole, stamp, np.column_stack(columns), strict=True)
        )
    )
    found = draft(path)["columns"]
    assert found["accel"] == {"unit": "m/s^2"} and found["gyro"] == {"unit": "rad/s"}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.gyro, GYRO, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(recording.accel, ACCEL, rtol=1e-6, atol=1e-9)
    assert recording.time[-1] - recording.time[0] == pytest.approx(TIME[-1] - TIME[0], rel=1e-3)


def test_a_device_that_is_carried_without_rest(tmp_path):
    """No unit shows by gravity's turn: rates of 1.2 at most with quiet moments are rad/s, and shaken gravity is 1 g
    in the moments that move least."""
    rng = np.random.default_rng(5)
    time = np.arange(12_000) / 100.0
    shaking = np.abs(np.sin(2 * np.pi * time / 20.0))[:, None]
    gyro = 0.5 * shaking * rng.normal(size=(12_000, 3)).clip(-2.4, 2.4) + 0.002 * rng.normal(
        size=(12_000, 3)
    )
    accel = np.array([0.0, 0.0, G]) + 25.0 * shaking * rng.normal(size=(12_000, 3))
    path = written(tmp_path / "walk.csv", (time, accel, gyro), f"t,{CANONICAL}")
    found = draft(path)["columns"]
    assert found["accel"]["unit"] == "m/s^2" and found["gyro"]["unit"] == "rad/s"
    assert lacks_gravity(accel - [0.0, 0.0, G]) and not lacks_gravity(accel)


def test_rows_of_several_sensors_are_refused_with_the_line_that_takes_the_imu_out(tmp_path):
    """As a flight controller's replay has them: `4000,imu,...` between `4000,mag,...`."""
    rows = [f"{k},imu,0,0,{G},0,0,0\n{k},mag,0.2,0.1,0.4,0,0,0\n" for k in range(50)]
    (tmp_path / "replay.csv").write_text("".join(rows))
    with pytest.raises(ValueError, match=r"'\$2 == \"imu\"' replay\.csv > imu\.csv"):
        draft(tmp_path / "replay.csv")


def test_counts_without_names_may_be_of_a_magnetometer(tmp_path):
    counts = np.round(ACCEL / G * 470.0 + [170.0, 10.0, -160.0])
    path = written(tmp_path / "data.csv", (counts,))
    assert draft(path)["columns"]["accel"]["unit"] == "count"
    assert "may be a magnetometer's as well" in (tmp_path / "campaign.toml").read_text()


def test_one_array_beside_its_stamps(tmp_path):
    """A MATLAB file's `timestamps` and `imu_data`, n rows of six numbers."""
    names = ",".join(["timestamps", *(f"imu_data_{k}" for k in range(6))])
    found = draft(written(tmp_path / "log.csv", (TIME, ACCEL, GYRO), names))["columns"]
    assert found["accel"]["names"] == ["imu_data_0", "imu_data_1", "imu_data_2"]
    assert found["gyro"] == {"names": ["imu_data_3", "imu_data_4", "imu_data_5"], "unit": "rad/s"}


def test_a_unit_in_the_names_stands_where_a_bias_moves_gravity(tmp_path):
    """One pose, z up, with a bias of -0.23 g: no converter of 0.77 counts per g."""
    rng = np.random.default_rng(3)
    accel = np.array([0.1, 0.05, 0.77]) + 0.003 * rng.normal(size=(4000, 3))
    columns = (np.arange(4000) / 180.0, accel)
    found = draft(written(tmp_path / "log.csv", columns, "time,x (g),y (g),z (g)"))["columns"]
    assert found["accel"] == {"names": ["x (g)", "y (g)", "z (g)"], "unit": "g"}
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK accel: as the file says; |a| is 0.778" in text and "poses of other axes" in text
    # Physics has it where the name errs by more than any part does.
    found = draft(written(tmp_path / "log.csv", (columns[0], G * accel), "time,x (g),y (g),z (g)"))
    assert found["columns"]["accel"]["unit"] == "m/s^2"


def test_samples_along_the_rows_of_a_matlab_array(tmp_path):
    """As OpenShoe stores them: forces and rates in six rows, the attitude's matrix in nine."""
    flat = (
        Rotation.from_euler("z", np.linspace(0.0, 6.0, len(TIME))[:, None])
        .as_matrix()
        .reshape(-1, 9)
        .T
    )
    path = tmp_path / "walk.mat"
    scipy.io.savemat(path, {"u": np.vstack([ACCEL.T, GYRO.T]), "dcm": flat})
    found = draft(path)
    assert found["columns"]["accel"] == {"names": ["u_0", "u_1", "u_2"], "unit": "m/s^2"}
    assert found["columns"]["gyro"]["names"] == ["u_3", "u_4", "u_5"]
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, rtol=1e-9)
    # Other data of the file stay so, where arrays stand upright.
    scipy.io.savemat(path, {"t": TIME, "acc": ACCEL, "gyr": GYRO, "raw": np.zeros((40, 9000))})
    assert draft(path)["columns"]["accel"]["names"] == ["acc_x", "acc_y", "acc_z"]


def test_a_heading_that_nothing_confirms_is_no_table(tmp_path):
    """Gravity says nothing of an upright axis, and there are no gyros."""
    rng = np.random.default_rng(4)
    still = np.repeat(np.arange(8) % 2 == 0, 500)
    heading = np.cumsum(np.where(still, 0.0, 0.002))
    accel = np.array([0.1, 0.2, G]) + np.where(still, 0.005, 1.0)[:, None] * rng.normal(
        size=(4000, 3)
    )
    path = written(
        tmp_path / "log.csv", (np.arange(4000) / 100.0, accel, heading), "t,ax,ay,az,psi"
    )
    assert "table_angles" not in draft(path)["columns"]


def test_counts_of_magnetometers_get_a_scale_that_is_said_to_be_a_guess(tmp_path):
    up = Rotation.random(3000, random_state=6).apply([0.0, 0.0, 1250.0])
    counts = np.round(up * [0.7, 1.0, 1.3] + [6200.0, 250.0, 3480.0])
    path = written(tmp_path / "log.csv", (counts,), "mx,my,mz")
    path.write_text("Fs,50.00\n" + path.read_text())
    found = draft(path)["columns"]["mag"]
    assert found["unit"] == "count" and found["scale_unit"] == "count per uT"
    assert found["scale"] == pytest.approx(1250.0 / 50.0, rel=0.1)
    assert "CHECK mag: counts that move by" in (tmp_path / "campaign.toml").read_text()


def test_a_further_clock_is_no_accelerometer(tmp_path):
    """Seconds since 1970 and the time of day before the triads of a file without names."""
    stamps = 1.74e9 + TIME
    day = [f"16:{int(t // 60):02d}:{t % 60:05.2f}" for t in TIME]
    rows = [
        ",".join([f"{s:.3f}", d, *(f"{v:.6g}" for v in (*a, *w))])
        for s, d, a, w in zip(stamps, day, ACCEL, GYRO)
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    found = draft(path)
    assert found["recordings"]["names"][2:] == [
        "accel_x",
        "accel_y",
        "accel_z",
        "gyro_x",
        "gyro_y",
        "gyro_z",
    ]


@pytest.mark.parametrize(
    "above, clock, per_degree, gyro",
    [
        ("MPU6050, +-4g +-500dps, DLPF 42Hz", "micros", 65.5, 65.5),
        ('"gyro_lowpass_hz","42"\n"motor_pwm_rate","480"', "time", 1.0, None),  # Betaflight
        ("DLPF 42 Hz, ODR 50 Hz", "n", 65.5, 65.5),
    ],
)
def test_what_stands_above_the_header_of_other_rates_is_not_the_log_s(
    tmp_path, above, clock, per_degree, gyro
):
    """A filter's corner was taken for the rate, beside stamps, and the gyros' scale was what fitted it."""
    stamps = np.arange(len(TIME)) if clock == "n" else np.round(1e6 * TIME)
    columns = (stamps, np.round(2048 * ACCEL / G), np.round(per_degree * GYRO / DEGREE))
    found = draft(written(tmp_path / "log.csv", columns, f"{above}\n{clock},{CANONICAL}"))
    told = {"rate": 50.0} if clock == "n" else {"name": clock, "unit": "us"}
    assert found["columns"]["time"] == told
    assert found["columns"]["gyro"].get("scale") == gyro
    assert found["columns"]["gyro"]["unit"] == ("deg/s" if gyro is None else "count")


def test_the_chip_and_its_range_above_the_header_tell_the_scales_of_counts(tmp_path):
    still = np.tile([[0.0, 0.0, 2048.0, 60.0, -20.0, 8.0]], (2000, 1))
    noise = np.random.default_rng(0).integers(-4, 5, (2000, 6))
    columns = (20000.0 * np.arange(2000), still + noise, noise[:, 0] - 500.0)
    path = written(tmp_path / "log.csv", columns, f"MPU6050 +-500dps\nmicros,{CANONICAL},temp")
    found = draft(path)["columns"]
    assert found["gyro"]["scale"] == 65.5 and found["temperature"]["scale"] == 340.0
    written_text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK gyro" in written_text and "CHECK temperature" not in written_text


def test_thousandths_of_degrees(tmp_path):
    columns = (TIME, ACCEL, np.round(1000.0 * GYRO / DEGREE))
    path = written(tmp_path / "log.csv", columns, "t,ax,ay,az,gx [mdps],gy [mdps],gz [mdps]")
    draft(path)
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.gyro, GYRO, atol=DEGREE / 1000.0)


def test_words_between_the_rows_of_a_serial_monitor_are_no_data(tmp_path):
    """As a sketch prints them that asks for the next position."""
    rows = [", ".join(f"{v:.7g}" for v in row) for row in ACCEL]
    ask = [">>> Place it on a flat, stable surface!", ">>> Type a key when ready..."]
    lines = ["--- Available filters: debug, default, direct, hexlify", "Type:  Acceleration (m/s2)"]
    lines += ["x, y, z", *ask, *rows[:1500], ask[1], *rows[1500:], *ask]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    assert draft(path)["columns"]["accel"] == {"names": ["x", "y", "z"], "unit": "m/s^2"}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, rtol=1e-6)


def test_accelerometers_in_millimetres(tmp_path):
    """A 3D printer's firmware writes `#time,accel_x,accel_y,accel_z` so: no counts of 8192 per g."""
    path = written(tmp_path / "log.csv", (TIME, 1000 * ACCEL), "#time,accel_x,accel_y,accel_z")
    assert draft(path)["columns"]["accel"]["unit"] == "mm/s^2"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, rtol=1e-6)
    header = "time,ax (cm/s^2),ay (cm/s^2),az (cm/s^2)"
    path = written(tmp_path / "log.csv", (TIME, 100 * ACCEL), header)
    assert draft(path)["columns"]["accel"]["unit"] == "cm/s^2"


def test_stamps_that_begin_anew_once_keep_their_step(tmp_path):
    """A board that was switched on again after 788 s: its mean rate over all stamps is none."""
    time = 788.0 + TIME
    time[1000:] = TIME[1000:] - TIME[1000] + 3.0
    time[1000:] += 0.001 * (np.arange(len(TIME) - 1000) % 2)
    found = draft(written(tmp_path / "log.csv", (time, ACCEL, GYRO), f"t,{CANONICAL}"))["columns"]
    assert found["time"] == {"name": "t", "unit": "s", "mend": True}
    (recording,) = load_campaign(tmp_path).recordings
    steps = np.diff(recording.time)
    assert (
        np.median(steps) == pytest.approx(TIME[1] - TIME[0], rel=1e-3) and steps.max() == steps[999]
    )


def test_milliseconds_since_1970_that_repeat_are_no_accelerometer(tmp_path):
    stamps = np.floor(1.586e12 + 1000.0 * TIME / 3.0)
    stamps[5::7] = stamps[4::7][: len(stamps[5::7])]
    rows = [",".join([f"{s:.0f}", *(f"{v:.6g}" for v in a)]) for s, a in zip(stamps, ACCEL)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    assert draft(path)["recordings"]["names"] == ["time", "accel_x", "accel_y", "accel_z"]


def test_six_means_beside_what_they_should_be(tmp_path):
    """A table of means and scatters on six faces, with a bias of -0.25 g; all elements of the matrix by hand."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])[[2, 5, 1, 4, 0, 3]]
    matrix = np.eye(3) + [[0.0, 0.005, 0.009], [-0.005, 0.0, 0.01], [-0.009, -0.004, 0.023]]
    means = faces @ matrix.T + [0.09, 0.05, -0.25]
    columns = np.stack([faces, means, np.full((6, 3), 0.004)], axis=2).reshape(6, 9)
    header = ",".join(f"{a}_true (g),{a}_mean (g),{a}_std" for a in "xyz")
    found = draft(written(tmp_path / "six.csv", (columns,), header))["columns"]
    assert found["accel"] == {"names": ["x_mean (g)", "y_mean (g)", "z_mean (g)"], "unit": "g"}
    assert found["position"] == {"row_index": True}
    assert found["reference_accel"]["names"][0] == "x_true (g)"
    (result,) = calibrate(load_campaign(tmp_path))
    accel = result.accel
    assert accel is not None
    values = np.ravel(accel.solution.curve.coefficients)
    named = dict(zip(accel.estimator.names, values, strict=True))
    assert named["accel.matrix[2,2]"] == pytest.approx(0.023, abs=1e-5)
    assert named["accel.matrix[0,2]"] == pytest.approx(0.009, abs=1e-5)


def test_times_since_1970_are_in_the_unit_that_makes_them_our_years(tmp_path):
    """A phone at two samples a second: in microseconds its rate were an IMU's."""
    time = 1.586e12 + 573.0 * np.arange(400)
    accel = ACCEL[:400] + 0.0
    path = written(tmp_path / "log.csv", (accel,), "ax,ay,az")
    rows = path.read_text().splitlines()
    rows = ["timestamp," + rows[0], *(f"{t:.0f},{r}" for t, r in zip(time, rows[1:], strict=True))]
    path.write_text("\n".join(rows) + "\n")
    assert draft(path)["columns"]["time"] == {"name": "timestamp", "unit": "ms"}


@pytest.mark.parametrize("gravity", [1.0, G])
def test_increments_of_velocity_and_angle_are_divided_by_their_step(tmp_path, gravity):
    """A navigation unit's text: at 50 Hz 1 g reads 0.02 in g or 0.196 in m/s^2, and the gyros' part is as small."""
    rows = (TIME, GYRO / 50.0, ACCEL * gravity / G / 50.0)
    found = draft(written(tmp_path / "imu.txt", rows, delimiter=" "))["columns"]
    per = "g" if gravity == 1.0 else "m/s^2"
    assert found["accel"] == {"unit": "count", "scale": 0.02, "scale_unit": f"count per {per}"}
    assert found["gyro"] == {"unit": "count", "scale": 0.02, "scale_unit": "count per rad/s"}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-3)
    np.testing.assert_allclose(recording.gyro, GYRO, atol=1e-4)


def test_no_log_ends_within_a_second_by_a_clock_finer_than_a_microsecond(tmp_path):
    """Half a second from row to row, by a computer's clock: in milliseconds it were 2 kHz for 0.2 s."""
    time = 0.5 * np.arange(400) + 0.001 * np.random.default_rng(2).random(400)
    path = written(tmp_path / "log.csv", (np.zeros(400), ACCEL[:400]), "Time,ax,ay,az")
    rows = path.read_text().splitlines()[1:]
    rows = [f"{t:.12f}{r[r.index(',') :]}" for t, r in zip(time, rows, strict=True)]
    path.write_text("\n".join(["Time,ax,ay,az", *rows]) + "\n")
    assert draft(path)["columns"]["time"] == {"name": "Time", "unit": "s"}


def test_a_converter_reads_no_rate_beyond_its_range():
    """A Shimmer's deg/s go in steps that, as rad/s, were those of a converter for 250 deg/s."""
    step = np.radians(0.00875)
    values = step * np.round(np.random.default_rng(1).normal(0.0, 20.0, (4000, 3)))
    assert gyro_unit(values, None, "").certain
    values[2000:2100] = step * np.round(np.linspace(0.0, 150.0, 100)[:, None] / step)
    assert not gyro_unit(values, None, "").certain


@pytest.mark.parametrize("size", [0.3, 0.8])
def test_an_acceleration_without_gravity_reads_it_in_no_unit(tmp_path, size):
    """A walk, as a phone's user acceleration has it; its norm may be near 1, or calm moments lie about a point."""
    rng = np.random.default_rng(4)
    accel = size * rng.normal(size=(len(TIME), 3)).cumsum(axis=0) / 20.0
    accel = (accel - accel.mean(axis=0)) * np.abs(np.sin(2.0 * TIME))[:, None]
    with pytest.raises(ValueError, match="read gravity in no unit"):
        draft(written(tmp_path / "log.csv", (TIME, accel), "time,Acc_x,Acc_y,Acc_z"))


def test_stamps_that_stand_twice_and_a_footer_leave_the_clock(tmp_path):
    """Without names the first column is the clock, though a host stamped two rows alike; words may stand below."""
    stamps = TIME - TIME[0]
    stamps[1] = stamps[0]
    path = written(tmp_path / "log.txt", (stamps, ACCEL / G, GYRO / DEGREE), delimiter="\t")
    found = draft(path)
    assert found["recordings"]["names"][:2] == ["time", "accel_x"]
    assert found["columns"]["time"] == {"name": "time", "unit": "s", "mend": True}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(np.diff(recording.time)[2:], 0.02, rtol=1e-3)
    path = written(tmp_path / "named.csv", (TIME, ACCEL / G), "t_s,ax,ay,az")
    path.write_text(path.read_text() + "TEMPS,21.6,21.4,20.0\n")
    assert draft(path)["columns"]["time"]["rate"] == pytest.approx(50.0, rel=0.01)


@pytest.mark.parametrize(
    "chamber",
    [
        "T_Kammer [degC]",
        "Chamber Temp (C)",
        "ambient_temp_C",
        "T_set [C]",
        "Temp. étuve [°C]",
        "Temp_aire_horno",
    ],
)
def test_the_device_s_temperature_is_taken_and_not_the_chamber_s_before_it(tmp_path, chamber):
    warm = 20.0 + TIME / 60.0
    columns = (TIME, warm + 3.0, ACCEL, GYRO, warm)
    draft(written(tmp_path / "log.csv", columns, f"time_s,{chamber},{CANONICAL},Temp_2 [C]"))
    text = (tmp_path / "campaign.toml").read_text()
    assert f"{chamber}: a further temperature" in text
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.temperature[:, 0], warm, rtol=1e-5)


@pytest.mark.parametrize("chamber", ["Chamber Temp (C)", "T_Kammer [degC]"])
def test_the_chamber_s_temperature_is_taken_where_there_is_none_else(tmp_path, chamber):
    columns = (TIME, 20.0 + TIME / 60.0, ACCEL, GYRO)
    found = draft(written(tmp_path / "log.csv", columns, f"time_s,{chamber},{CANONICAL}"))
    assert found["columns"]["temperature"]["name"] == chamber


@pytest.mark.parametrize("beside, serial", [(None, "batch"), ("SN8.csv", "SN7")])
def test_the_serial_number_that_is_proposed_is_the_file_s_where_its_folder_holds_more(
    tmp_path, beside, serial
):
    """On a station: columns of references are what makes a log one."""
    home = tmp_path / "batch"
    home.mkdir()
    header = f"time_s,{CANONICAL},ref_ax,ref_ay,ref_az"
    log = written(home / "SN7.csv", (TIME, ACCEL, GYRO, ACCEL), header)
    if beside is not None:
        written(home / beside, (TIME, ACCEL, GYRO, ACCEL), header)
    draft(log)
    assert f'# serial = "{serial}"' in (home / "campaign.toml").read_text()


@pytest.mark.parametrize(
    "name, celsius, unit, told",
    [
        ("chip_temp_F", (27.0, 29.0), "degF", "as the file says; 80.6 to 84.2"),
        ("temp_f", (12.0, 25.0), "degF", "as the file says; 53.6 to 77"),
        ("temp", (27.0, 29.0), "degC", "80.6 to 84.2; if degF (27 to 29 degC), write so"),
    ],
)
def test_a_name_that_ends_in_f(tmp_path, name, celsius, unit, told):
    fahrenheit = np.linspace(*(32.0 + 1.8 * np.array(celsius)), len(TIME))
    columns = (1e3 * TIME, ACCEL / G, GYRO / DEGREE, fahrenheit)
    path = written(tmp_path / "log.csv", columns, f"now[ms],{CANONICAL},{name}")
    assert draft(path)["columns"]["temperature"] == {"name": name, "unit": unit}
    assert told in (tmp_path / "campaign.toml").read_text()


def test_a_filtered_temperature_is_no_fahrenheit(tmp_path):
    columns = (1e3 * TIME, ACCEL / G, GYRO / DEGREE, np.linspace(27.0, 29.0, len(TIME)))
    path = written(tmp_path / "log.csv", columns, f"now[ms],{CANONICAL},temp_f")
    assert draft(path)["columns"]["temperature"]["unit"] == "degC"


@pytest.mark.parametrize(
    "name, parts",
    [
        ("Temp [cdegC]", 100),
        ("T [0.01 degC]", 100),
        ("T [cdegC]", 100),
        ("temp_x10", 10),
        ("temperature_mdeg", 1000),
        ("temp (1/100 °C)", 100),
    ],
)
def test_parts_of_a_degree_that_a_name_says_are_no_converter_s_counts(tmp_path, name, parts):
    celsius = np.round(np.linspace(-18.0, 60.0, len(TIME)), 1)
    columns = (1e3 * TIME, ACCEL / G, GYRO / DEGREE, np.round(parts * celsius))
    path = written(tmp_path / "log.csv", columns, f"now[ms],{CANONICAL},{name}")
    draft(path)
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.temperature[:, 0], celsius, atol=1e-9)
    assert "CHECK temperature" not in (tmp_path / "campaign.toml").read_text()


@pytest.mark.parametrize("name", ["imu_degC", "sensor_deg_c", "die degC", "board_celsius"])
def test_a_unit_behind_a_word_makes_a_temperature(tmp_path, name):
    columns = (1e3 * TIME, ACCEL / G, GYRO / DEGREE, np.linspace(-8.0, 57.0, len(TIME)))
    path = written(tmp_path / "log.csv", columns, f"now[ms],{CANONICAL},{name}")
    assert draft(path)["columns"]["temperature"] == {"name": name, "unit": "degC"}


def test_seconds_that_name_and_temperature_both_say_are_certain(tmp_path):
    """Three settings of a chamber, 45 minutes apart: in milliseconds the temperature would jump by 30 °C a second."""
    runs = np.array_split(np.arange(len(TIME)), 3)
    stamps = np.concatenate([TIME[rows] + 2700.0 * k for k, rows in enumerate(runs)])
    heat = np.concatenate(
        [np.linspace(a, b, len(r)) for (a, b), r in zip([(-8, -2), (31, 26), (52, 57)], runs)]
    )
    path = written(
        tmp_path / "log.csv", (stamps, ACCEL / G, GYRO / DEGREE, heat), f"stamp_s,{CANONICAL},T_imu"
    )
    assert draft(path)["columns"]["time"] == {"name": "stamp_s", "unit": "s"}
    said = (tmp_path / "campaign.toml").read_text()
    assert "# time: as the file says" in said and "CHECK time" not in said


def test_rows_of_a_filter_between_those_of_the_sensors_have_a_clock_of_their_own(tmp_path):
    """As MicroStrain's tools write them: each second row is the filter's, stamped before the sample above it."""
    lines = ["timestamp,ax,ay,az,gx,gy,gz,roll"]
    for k, (t, a, w) in enumerate(zip(TIME, ACCEL, GYRO, strict=True)):
        stamp = 1_730_000_000_000_000_000 + round(1e9 * t)
        lines.append(f"{stamp},{','.join(f'{v:.6f}' for v in (*a, *w))},")
        if k % 2:
            lines.append(f"{stamp - 4_000_000},,,,,,,0.5")
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    assert draft(path)["columns"]["time"] == {"name": "timestamp", "unit": "ns"}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(np.diff(recording.time), np.diff(TIME), atol=1e-6)


def test_days_of_a_spreadsheet_are_a_clock(tmp_path):
    """Whole days since 1900, and parts of them: 1 ms is 1e-8 of a day."""
    path = tmp_path / "log.csv"
    lines = [
        f"{45000.5 + t / 86400.0:.10f},{','.join(f'{v:.6f}' for v in (*a, *w))}"
        for t, a, w in zip(TIME, ACCEL, GYRO, strict=True)
    ]
    path.write_text("\n".join(["time (days),ax,ay,az,gx,gy,gz", *lines]) + "\n")
    assert draft(path)["columns"]["time"] == {"name": "time (days)", "unit": "d"}
    (recording,) = load_campaign(tmp_path).recordings
    # A double near 45000 days is told to 7e-12 of them, 0.6 µs; the text to 10 digits, 4 µs.
    np.testing.assert_allclose(recording.time - recording.time[0], TIME - TIME[0], atol=1e-5)


def test_one_rest_of_a_device_that_moves_is_not_all_its_poses(tmp_path):
    """Held for a second or two in each pose: an estimator for one pose would hide how few rests there are."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 36.0, 0.01)
    up = np.repeat(
        [[0.0, 0, 1], [1, 0, 0], [0, 1, 0], [0, -1, 0], [-1, 0, 0], [0, 0, -1]], 600, axis=0
    )
    shaken = np.where((time < 6.0) & (time > 1.0), 0.01, 1.0)[:, None]
    accel = G * up + shaken * rng.standard_normal(up.shape)
    path = written(tmp_path / "log.csv", (time, accel), "time,ax,ay,az")
    assert "model" not in draft(path)


def test_one_motion_tells_no_unit_in_which_the_zero_is_no_gyro_s(tmp_path):
    """Of a public log of a rocket one motion of 5 deg was met by outputs as rad/s, whose zero was 2.5: 143 deg/s."""
    time = np.arange(3000) / 100.0
    rate = np.where((time > 10.0) & (time < 12.0), 0.4, 0.0)
    angle = np.cumsum(rate) / 100.0
    rng = np.random.default_rng(3)
    accel = np.column_stack([0.0 * angle, np.sin(angle), np.cos(angle)])
    accel += 1e-3 * rng.normal(size=accel.shape)
    gyro = np.column_stack([rate, 0.0 * rate, 0.0 * rate]) + 1e-3 * rng.normal(size=accel.shape)
    for zero, told in ((0.05, True), (2.5, False)):
        shifted = gyro + [0.1 * zero, -zero, 0.0]
        path = written(tmp_path / "log.csv", (time, accel, shifted), f"t,{CANONICAL}")
        unit = draft(path)["columns"]["gyro"]["unit"]
        said = (tmp_path / "campaign.toml").read_text()
        assert (unit, "CHECK gyro" in said) == (("rad/s", False) if told else ("deg/s", True))


def test_whole_numbers_that_end_at_2000_are_degrees_per_second(tmp_path):
    """A boomerang's gyro stood at -2000; it was taken for counts of a range of 250 deg/s."""
    rate = np.round(np.random.default_rng(6).normal(0.0, 3.0, (600, 3)))
    rate[200:400, 2] = np.maximum(-40.0 * np.minimum(np.arange(200), np.arange(200)[::-1]), -2000.0)
    path = written(tmp_path / "gyro.csv", (rate,), "wx,wy,wz")
    assert draft(path)["columns"]["gyro"] == {"names": ["wx", "wy", "wz"], "unit": "deg/s"}


def test_stamps_of_an_mti_that_lack_rows_are_tenths_of_ms(tmp_path):
    """They were microseconds: 10 kHz."""
    stamps = 281696 + 200 * np.arange(len(TIME))
    kept = np.random.default_rng(8).random(len(TIME)) > 0.02
    columns = (stamps[kept], ACCEL[kept], GYRO[kept])
    path = written(tmp_path / "log.csv", columns, "SampleTimeFine,ax,ay,az,gx,gy,gz")
    assert draft(path)["columns"]["time"] == {"name": "SampleTimeFine", "unit": "0.1 ms"}
    (recording,) = load_campaign(tmp_path).recordings
    assert np.median(np.diff(recording.time)) == pytest.approx(0.02, abs=1e-9)


@pytest.mark.parametrize(
    ("step", "jitter", "marked"), [(100, 0, True), (100, 3, False), (10, 0, False)]
)
def test_a_slow_clock_without_a_unit_is_marked(tmp_path, step, jitter, marked):
    """A public log's `time` in tenths of ms, 100 Hz, was read as 10 Hz without a word."""
    off = np.random.default_rng(9).integers(0, jitter + 1, 600)
    stamps = 281696 + step * np.arange(600) + off
    rest = np.random.default_rng(10).normal([0.1, 0.2, 9.8], 0.01, (600, 3))
    draft(written(tmp_path / "log.csv", (stamps, rest), "time,ax,ay,az"))
    text = (tmp_path / "campaign.toml").read_text()
    assert ("CHECK time" in text) == marked
    assert ('unit = "0.1 ms", 100 Hz' in text) == marked


def test_counts_that_leave_what_electronics_bears_are_no_temperature(tmp_path):
    """`Temp/q0` of an MTi-G, 47 °C at the median by an MPU-6500's data sheet, went to 156 °C."""
    counts = np.where(np.arange(len(TIME)) % 3, 7600.0, 45240.0)
    path = written(
        tmp_path / "log.csv", (TIME, ACCEL, GYRO, counts), "time,ax,ay,az,gx,gy,gz,Temp/q0"
    )
    assert "temperature" not in draft(path)["columns"]
    assert "CHECK temperature: Temp/q0" in (tmp_path / "campaign.toml").read_text()


@pytest.mark.parametrize("counts", [True, False])
def test_counts_of_a_temperature_are_a_chip_s_beside_such_accelerometers(tmp_path, counts):
    """An MTi-G's, which are 1/256 degC, were an MPU-6500's without a mark, by their size alone."""
    accel = np.round(16384.0 * ACCEL / G) if counts else ACCEL
    raw = np.round(8600.0 + 100.0 * np.sin(TIME))
    path = written(tmp_path / "log.csv", (TIME, accel, GYRO, raw), "time,ax,ay,az,gx,gy,gz,temp")
    assert draft(path)["columns"]["temperature"]["scale"] == 333.87
    assert ("CHECK temperature" in (tmp_path / "campaign.toml").read_text()) != counts
