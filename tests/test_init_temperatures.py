"""`inertiax init` where a log holds several temperatures: the inertial sensors' own, by names alone."""

import pytest

from hand_log_data import CANONICAL, draft, hand_log, written


TIME, ACCEL, GYRO = hand_log()
WARM = 40.0 + TIME / 60.0


def drafted(tmp_path, names, *, dead=()):
    """The temperature's name and its reason in the draft, of a log with these temperatures before the sensors."""
    tmp_path.mkdir(exist_ok=True)
    probes = [0.0 * WARM if n in dead else WARM - 3.0 * k for k, n in enumerate(names)]
    path = written(
        tmp_path / "log.csv", (TIME, *probes, ACCEL, GYRO), ",".join(["time_s", *names, CANONICAL])
    )
    found = draft(path)
    lines = (tmp_path / "campaign.toml").read_text().splitlines()
    (place,) = (k for k, line in enumerate(lines) if line.startswith("temperature = "))
    return found["columns"]["temperature"]["name"], lines[place - 1]


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        (("AHT_tmp[C]", "BMP_temp[C]", "gtemp"), "gtemp"),
        (("baro_temp_C", "temp_C"), "temp_C"),
        (("board_temp_C", "imu_temp_C"), "imu_temp_C"),
        (("temp_C", "gyro_temp_C", "humidity_temp_C"), "gyro_temp_C"),
        (("cpu_temp_C", "board_temp_C"), "board_temp_C"),
    ],
)
def test_of_several_temperatures_the_sensors_own_is_taken_and_all_are_named(tmp_path, names, taken):
    name, why = drafted(tmp_path, names)
    assert name == taken
    assert why.startswith("# CHECK temperature: ") and all(n in why for n in names)


def test_one_logger_has_one_temperature_whatever_another_reads(tmp_path):
    names = ("AHT_tmp[C]", "gtemp")
    live, _ = drafted(tmp_path / "a", names)
    dead, why = drafted(tmp_path / "b", names, dead=("AHT_tmp[C]",))
    assert live == dead == "gtemp" and "CHECK" not in why


def test_a_chamber_s_air_beside_the_device_s_is_no_rival(tmp_path):
    name, why = drafted(tmp_path, ("chamber_temp_C", "temp_C"))
    assert name == "temp_C" and "CHECK" not in why
