"""Header lines of loggers of many makers, as public repositories have them: which columns are the sensors'."""

from pathlib import Path

import numpy as np
import pytest

from hand_log_data import CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.column_roles import roles_of
from inertiax.campaign_draft.column_triads import triads_by_name
from inertiax.campaign_draft.column_words import FORCE_UNITS, RATE_UNITS, said, TIME_UNITS
from inertiax.campaign_draft.raw_log import RawLog
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.csv import column_names
from inertiax.data.formats.text_layout import find_layout


# Logger, its header line; then by number from 0 the columns of time, of the accelerometers' x, of the gyros' x and of
# the temperature, and the units that words of these name.
HEADERS = [
    ("ROS, own exporter", "t,xla,yla,zla,xav,yav,zav", 0, 1, 4, None, (None, None, None)),
    ("ROS, own exporter with attitude", "ts,xo,yo,zo,wo,xav,yav,zav,xla,yla,zla", 0, 8, 5, None, (None, None, None)),
    ("rostopic echo -p", "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.orientation.x,"
     "field.orientation.y,field.orientation.z,field.orientation.w,field.angular_velocity.x,field.angular_velocity.y,"
     "field.angular_velocity.z,field.linear_acceleration.x,field.linear_acceleration.y,field.linear_acceleration.z",
     2, 11, 8, None, (None, "m/s^2", "rad/s")),
    ("PlotJuggler", "__time,/imu/data/angular_velocity/x,/imu/data/angular_velocity/y,/imu/data/angular_velocity/z,"
     "/imu/data/linear_acceleration/x,/imu/data/linear_acceleration/y,/imu/data/linear_acceleration/z,"
     "/imu/data/orientation/x,/imu/data/orientation/y,/imu/data/orientation/z", 0, 4, 1, None,
     (None, "m/s^2", "rad/s")),
    ("EuRoC, TUM-VI", "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
     "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]", 0, 4, 1, None, ("ns", "m/s^2", "rad/s")),
    ("Kalibr's bagcreater", "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z", 0, 4, 1, None,
     (None, None, None)),
    ("Boreas", "GPSTime,easting,northing,altitude,vel_east,vel_north,vel_up,roll,pitch,heading,angvel_z,angvel_y,"
     "angvel_x,accelz,accely,accelx,latitude,longitude", 0, 15, 12, None, (None, None, None)),
    ("MAVLink", "ts,xacc,yacc,zacc,xgyro,ygyro,zgyro,xmag,ymag,zmag,temperature", 0, 1, 4, 10, (None, None, None)),
    ("ArduPilot", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", 0, 5, 2, 10, ("us", None, None)),
    ("Betaflight", "loopIteration,time (us),axisP[0],gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],accSmooth[1],"
     "accSmooth[2],setpoint[0],setpoint[1],setpoint[2]", 1, 6, 3, None, ("us", None, None)),
    ("INAV", "loopIteration,time (us),axisRate[0],axisRate[1],axisRate[2],axisP[0],axisP[1],axisP[2],axisI[0],axisI[1],"
     "axisI[2],rcCommand[0],rcCommand[1],rcCommand[2],rcCommand[3],gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],"
     "accSmooth[1],accSmooth[2],attitude[0],attitude[1],attitude[2],motor[0],motor[1],motor[2],motor[3],imuTemperature,"
     "baroTemperature", 1, 18, 15, 28, ("us", None, None)),
    ("DJI DatCon", "Clock:offsetTime,IMU_ATTI(0):roll:C,IMU_ATTI(0):pitch:C,IMU_ATTI(0):yaw:C,IMU_ATTI(0):accelX,"
     "IMU_ATTI(0):accelY,IMU_ATTI(0):accelZ,IMU_ATTI(0):gyroX,IMU_ATTI(0):gyroY,IMU_ATTI(0):gyroZ,"
     "IMU_ATTI(0):magX,IMU_ATTI(0):magY,IMU_ATTI(0):magZ", 0, 4, 7, None, (None, None, None)),
    ("DJI DatCon, later", "offsetTime,IMU_ATTI(0):accel:X,IMU_ATTI(0):accel:Y,IMU_ATTI(0):accel:Z,"
     "IMU_ATTI(0):accel:Composite,IMU_ATTI(0):gyro:X,IMU_ATTI(0):gyro:Y,IMU_ATTI(0):gyro:Z", 0, 1, 5, None,
     (None, None, None)),
    ("GoPro telemetry", "cts,date,Accelerometer (z) [m/s²],Accelerometer (x) [m/s²],Accelerometer (y) [m/s²],"
     "Gyroscope (z) [rad/s],Gyroscope (x) [rad/s],Gyroscope (y) [rad/s],temperature [°C]", 0, 3, 6, 8,
     (None, "m/s^2", "rad/s")),
    ("phyphox", "Time (s);Acceleration x (m/s^2);Acceleration y (m/s^2);Acceleration z (m/s^2);Gyroscope x (rad/s);"
     "Gyroscope y (rad/s);Gyroscope z (rad/s)", 0, 1, 4, None, ("s", "m/s^2", "rad/s")),
    ("SensorLog", "loggingTime(txt),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),"
     "accelerometerAccelerationY(G),accelerometerAccelerationZ(G),motionYaw(rad),motionRoll(rad),motionPitch(rad),"
     "motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s),motionUserAccelerationX(G),"
     "motionUserAccelerationY(G),motionUserAccelerationZ(G),motionGravityX(G),motionGravityY(G),motionGravityZ(G)",
     0, 2, 8, None, (None, "g", "rad/s")),
    ("GNSSLogger", "utcTimeMillis,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2,BiasYMps2,BiasZMps2,"
     "UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec,DriftXRadPerSec,DriftYRadPerSec,DriftZRadPerSec",
     0, 1, 7, None, ("ms", "m/s^2", "rad/s")),
    ("a phone's dataset", "lat,lng,alt,timestamp,x_acc,y_acc,z_acc,x_gyro,y_gyro,z_gyro,x_gravity,y_gravity,z_gravity",
     3, 4, 7, None, (None, None, None)),
    ("a robot's imu.csv", "timestamp [s],ang_vel_x,ang_vel_y,ang_vel_z,lin_acc_x,lin_acc_y,lin_acc_z", 0, 4, 1, None,
     ("s", None, None)),
    ("Movella MT Manager", "PacketCounter\tSampleTimeFine\tYear\tMonth\tDay\tSecond\tAcc_X\tAcc_Y\tAcc_Z\tFreeAcc_E"
     "\tFreeAcc_N\tFreeAcc_U\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z\tRoll\tPitch\tYaw", 1, 6, 12, None,
     ("us", None, None)),
    ("VectorNav, INSTINCT", "Time [s],GpsCycle,GpsWeek,GpsToW,TimeStartup,UnCompMagX,UnCompMagY,UnCompMagZ,UnCompAccX,"
     "UnCompAccY,UnCompAccZ,UnCompGyroX,UnCompGyroY,UnCompGyroZ,Temperature", 0, 8, 11, 14, ("s", None, None)),
    ("LPMS", "SensorId, TimeStamp (s), FrameNumber, AccX (g), AccY (g), AccZ (g), GyroX (deg/s), GyroY (deg/s), "
     "GyroZ (deg/s), MagX (uT), MagY (uT), MagZ (uT), EulerX (deg), EulerY (deg), EulerZ (deg), QuatW, QuatX, QuatY, "
     "QuatZ, LinAccX (g), LinAccY (g), LinAccZ (g)", 1, 3, 6, None, ("s", "g", "deg/s")),
    ("WitMotion", "Chiptime\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\tAngleX(deg)\tAngleY(deg)"
     "\tAngleZ(deg)\tT(°)\tmagx\tmagy\tmagz", 0, 1, 4, 10, (None, "g", "deg/s")),
    ("WitMotion, Chinese", "时间\t加速度X(g)\t加速度Y(g)\t加速度Z(g)\t角速度X(°/s)\t角速度Y(°/s)\t角速度Z(°/s)"
     "\t角度X(°)\t角度Y(°)\t角度Z(°)\t温度(°C)", 0, 1, 4, 10, (None, "g", "deg/s")),
    ("in Russian", "Время, с;Ускорение X;Ускорение Y;Ускорение Z;Угловая скорость X;Угловая скорость Y;"
     "Угловая скорость Z;Температура", 0, 1, 4, 7, (None, None, None)),
    ("in Korean", "시간,가속도X,가속도Y,가속도Z,각속도X,각속도Y,각속도Z,온도", 0, 1, 4, 7, (None, None, None)),
    ("in Japanese", "時刻,加速度X,加速度Y,加速度Z,ジャイロX,ジャイロY,ジャイロZ", 0, 1, 4, None, (None, None, None)),
    ("ST DataLog", "Time [mS], AccX [mg], AccY [mg], AccZ [mg], GyroX [mdps], GyroY [mdps], GyroZ [mdps],MagX [mgauss],"
     "MagY [mgauss],MagZ [mgauss],P [mB],T ['C]", 0, 1, 4, 11, ("ms", "mg", "deg/s")),
    ("ST Unico", "Timestamp [us]\tA_X [mg]\tA_Y [mg]\tA_Z [mg]\tG_X [dps]\tG_Y [dps]\tG_Z [dps]", 0, 1, 4, None,
     ("us", "mg", "deg/s")),
    ("PicoQuake", "count,a_x,a_y,a_z,g_x,g_y,g_z", None, 1, 4, None, (None, None, None)),
    ("Axivity", "Time,Accel-X (g), Accel-Y (g), Accel-Z (g), Gyro-X (d/s), Gyro-Y (d/s), Gyro-Z (d/s)", 0, 1, 4, None,
     (None, "g", "deg/s")),
    ("ActiGraph", "Timestamp,Accelerometer X,Accelerometer Y,Accelerometer Z,Temperature,Gyroscope X,Gyroscope Y,"
     "Gyroscope Z,Magnetometer X,Magnetometer Y,Magnetometer Z", 0, 1, 5, 4, (None, None, None)),
    ("Shimmer", "Shimmer_8665_Timestamp_Unix_CAL\tShimmer_8665_Accel_LN_X_CAL\tShimmer_8665_Accel_LN_Y_CAL"
     "\tShimmer_8665_Accel_LN_Z_CAL\tShimmer_8665_Gyro_X_CAL\tShimmer_8665_Gyro_Y_CAL\tShimmer_8665_Gyro_Z_CAL",
     0, 1, 4, None, (None, None, None)),
    ("OpenBCI", "Sample Index, EXG Channel 0, EXG Channel 1, EXG Channel 2, EXG Channel 3, Accel Channel 0, "
     "Accel Channel 1, Accel Channel 2, Timestamp", 8, 5, None, None, (None, None, None)),
    ("Noraxon", "time,Pelvis Accel Sensor X (mG),Pelvis Accel Sensor Y (mG),Pelvis Accel Sensor Z (mG),"
     "Noraxon MyoMotion-Segments-Pelvis-Gyroscope-x (deg/s),Noraxon MyoMotion-Segments-Pelvis-Gyroscope-y (deg/s),"
     "Noraxon MyoMotion-Segments-Pelvis-Gyroscope-z (deg/s)", 0, 1, 4, None, (None, "mg", "deg/s")),
    ("an Arduino's SD card", "Time(ms),AccelX(g),AccelY(g),AccelZ(g),GyroX(rad/s),GyroY(rad/s),GyroZ(rad/s),"
     "MagnX(gauss),MagnY(gauss),MagnZ(gauss),MPUTemp(C),BaroTemp(C),Pressure(Pa)", 0, 1, 4, 10,
     ("ms", "g", "rad/s")),
    ("a flight logger", "t_wall_ns,time_usec,xacc,yacc,zacc,xgyro,ygyro,zgyro,abs_pressure", 0, 2, 5, None,
     ("ns", None, None)),
    ("three IMUs side by side", "t,imu0_ax,imu1_ax,imu2_ax,imu0_ay,imu1_ay,imu2_ay,imu0_az,imu1_az,imu2_az,imu0_wx,"
     "imu1_wx,imu2_wx,imu0_wy,imu1_wy,imu2_wy,imu0_wz,imu1_wz,imu2_wz", 0, 1, 10, None, (None, None, None)),
    ("a C++ logger", "beginsec,ACC_x,ACC_y,ACC_z,GYR_x,GYR_y,GYR_z,HX,HY,Hz,ROll,Pitch,Yaw", 0, 1, 4, None,
     ("s", None, None)),
    ("a unit below each", "t;ax;ay;az;ax;ay;az\ns;g;g;g;dps;dps;dps", 0, 1, 4, None, ("s", "g", "deg/s")),
    ("one name for three", "time,acc,acc,acc,gyr,gyr,gyr", 0, 1, 4, None, (None, None, None)),
    ("names twice", "time,ax,ay,az,ax,ay,az", 0, 1, 4, None, (None, None, None)),
    ("axes twice", "time,x,y,z,x,y,z", 0, 4, 1, None, (None, None, None)),
    ("two accelerometers of one name", "time,pressure,temp,ax,ay,az,ax,ay,az,gx,gy,gz", 0, 3, 9, 2,
     (None, None, None)),
]  # fmt: skip


def log_of(header: str, accel: int, gyro: int | None) -> RawLog:
    """A log under a header: all columns rise, but for a triad that reads gravity, one that turns, and a temperature."""
    delimiter = next(d for d in "\t;," if d in header)
    width = header.split("\n")[0].count(delimiter) + 1
    body = "\n".join(delimiter.join(["1.5"] * width) for _ in range(60))
    layout = find_layout(f"{header}\n{body}\n".encode(), "log.csv")
    names = column_names(layout, None, "log.csv")
    rows = np.arange(60.0)
    rng = np.random.default_rng(width)
    numbers = {n: k + 0.01 * rows for k, n in enumerate(names)}
    up = rng.normal(size=(3, 60))
    up *= 9.8 / np.linalg.norm(up, axis=0)
    rates = rng.normal(size=(3, 60)) * (1.0 + np.sin(rows))
    of = {t[0]: t for t in triads_by_name(names)}
    further = [t for t in of.values() if t[0].startswith(names[accel][:2]) and "(" in t[0]]
    for triad in further:
        numbers |= dict(zip(triad, 0.5 * up, strict=True))
    if gyro is not None:
        numbers |= dict(zip(of[names[gyro]], rates, strict=True))
    numbers |= dict(zip(of[names[accel]], up, strict=True))
    for name in {"T", "temp"} & set(names):
        numbers[name] = 25.0 + np.sin(rows)
    return RawLog(Path("log.csv"), "csv", layout, numbers, {}, {}, 0)


@pytest.mark.parametrize(
    "header, time, accel, gyro, temperature, units",
    [h[1:] for h in HEADERS],
    ids=[h[0] for h in HEADERS],
)
def test_columns_of_many_loggers_are_recognised(header, time, accel, gyro, temperature, units):
    log = log_of(header, accel, gyro)
    roles = roles_of(log)
    name = lambda k: None if k is None else log.names[k]
    first = lambda t: None if t is None else t[0]
    assert (first(roles.accel), first(roles.gyro)) == (name(accel), name(gyro))
    assert (roles.time, roles.temperature) == (name(time), name(temperature))
    words = [roles.time, first(roles.accel), first(roles.gyro)]
    tables = (TIME_UNITS, FORCE_UNITS, RATE_UNITS)
    told = [None if w is None else said(t, log.hint(w)) for t, w in zip(tables, words, strict=True)]
    assert tuple(told) == units


@pytest.mark.parametrize("names", ["t,ax,ay,az,ax,ay,az", "t,ax,ay,az,ux,uy,uz,vx,vy,vz"])
def test_gyros_whose_name_says_nothing_are_told_by_what_they_read(tmp_path, names):
    """By the norm of columns of one name; else, before other columns without a name, by how gravity turns."""
    time, accel, gyro = hand_log()
    noise = np.random.default_rng(1).normal(size=accel.shape)
    columns = [time[:, None], accel / G, gyro / DEGREE]
    columns = columns if names.count("ax") == 2 else [*columns[:2], noise, columns[2]]
    text = "\n".join(",".join(f"{v:.9g}" for v in row) for row in np.concatenate(columns, axis=1))
    (tmp_path / "log.csv").write_text(f"{names}\n{text}\n")
    made = draft_campaign(tmp_path / "log.csv", tmp_path).text
    (tmp_path / "campaign.toml").write_text(made)
    (read,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(read.accel, accel, atol=1e-6)
    np.testing.assert_allclose(read.gyro, gyro, atol=1e-6)


def _with_dead_columns(folder: Path, alive: bool) -> Path:
    """A hand log behind three accelerometer columns that the logger left at zero."""
    time, accel, gyro = hand_log()
    live = [accel / G] if alive else []
    columns = np.concatenate([time[:, None], np.zeros_like(accel), *live, gyro], axis=1)
    names = "t,accHigh[0],accHigh[1],accHigh[2]," + "acc[0],acc[1],acc[2]," * alive
    text = "\n".join(",".join(f"{v:.9g}" for v in row) for row in columns)
    (folder / "log.csv").write_text(f"{names}gyro[0],gyro[1],gyro[2]\n{text}\n")
    return folder / "log.csv"


def test_columns_of_zeros_stand_back_behind_columns_that_read(tmp_path):
    made = draft_campaign(_with_dead_columns(tmp_path, alive=True), tmp_path).text
    assert 'accel = { names = ["acc[0]", "acc[1]", "acc[2]"], unit = "g" }' in made


def test_accelerometers_of_zeros_alone_are_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match=r"accHigh\[0\], .* are zero throughout"):
        draft_campaign(_with_dead_columns(tmp_path, alive=False), tmp_path)


def test_a_name_that_stands_twice_is_not_guessed(tmp_path):
    (tmp_path / "log.csv").write_text("time,ax,ay,az,ax,ay,az\n" + "0,1,2,3,4,5,6\n" * 2)
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n[columns]\naccel = { names = ["ax", "ay", "az"] }\n'
    )
    said = r"column 'ax' stands more than once in the header; .*'ax \(1\)' or 'ax \(2\)'"
    with pytest.raises(ValueError, match=said):
        load_campaign(tmp_path)


@pytest.mark.parametrize("units", [(), ("ms,g,g,g,deg/s,deg/s,deg/s",)])
def test_names_that_stand_again_among_the_rows_are_left_out(tmp_path, units):
    """A sketch prints its greeting and its names, and maybe units below, once more when its board is switched on."""
    time, accel, gyro = hand_log()
    half = len(time) // 2
    clock = np.round(1e3 * np.r_[time[:half], time[half:] - time[half]]) + 2000.0
    path = written(tmp_path / "log.csv", (clock, accel / G, gyro / DEGREE), f"millis,{CANONICAL}")
    lines = path.read_text().splitlines()
    head = [lines[0], *units]
    parts = [*head, *lines[1 : half + 1], "MPU ok", *head, *lines[half + 1 :]]
    path.write_text("\n".join(parts) + "\n")
    found = draft(path)["columns"]
    assert found["time"] == {"name": "millis", "unit": "ms", "mend": True}
    assert (
        f"The names stand again in line {half + 3 + len(units)}"
        in (tmp_path / "campaign.toml").read_text()
    )
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.num_samples == len(time)
    np.testing.assert_allclose(recording.accel, accel, rtol=2e-6, atol=2e-6)
