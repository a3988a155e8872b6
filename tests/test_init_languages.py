"""`inertiax init` knows the column names of stations that write German, French, Spanish or Italian."""

import tomllib

import numpy as np
import pytest

from hand_log_data import DEGREE, G, hand_log
from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.column_roles import triads_by_name
from inertiax.campaign_draft.column_words import RATE_UNITS, said, TIME_UNITS
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
TEMPERATURE = 20.0 + TIME / 60.0
STEP = (np.arange(len(TIME)) // 275).astype(float)  # a label, one for each pose


def three(name, axes="xyz"):
    return [name.replace("_", a, 1) for a in axes]


# Names of time, accelerometers, gyros and temperature, with _ for the axis; what one unit of them is in SI; the units.
HEADERS = {
    "German": (
        ["Zeit_ms", *three("Beschl._ mg"), *three("Drehrate_ [Grad/s]"), "Temperatur_°C"],
        (1e-3, G / 1000, DEGREE), ("ms", "mg", "deg/s"),
    ),
    "German, of a vehicle": (
        ["Zeit [s]", "Längsbeschleunigung [m/s²]", "Querbeschleunigung [m/s²]", "Vertikalbeschleunigung [m/s²]",
         "Rollrate [°/s]", "Nickrate [°/s]", "Gierrate [°/s]", "Temp. Gehäuse"],
        (1.0, 1.0, DEGREE), ("s", "m/s^2", "deg/s"),
    ),
    "German, of axes": (
        ["Zeitstempel (µs)", *three("Beschleunigung _ in g", "XYZ"), *three("Winkelrate _ rad/s", "XYZ"),
         "T_Gehäuse"],
        (1e-6, G, 1.0), ("us", "g", "rad/s"),
    ),
    "German, short": (
        ["Zeit_s", "Beschl_x_mg", "Beschl_y_mg", "Beschl_z_mg", "Gierrate", "Nickrate", "Rollrate", "Temperatur_degC"],
        (1.0, G / 1000, 1.0), ("s", "mg", "rad/s"),
    ),
    "French": (
        ["Temps (s)", *three("Accélération _ (m/s²)"), *three("Vitesse angulaire _ (°/s)"), "Température (°C)"],
        (1.0, 1.0, DEGREE), ("s", "m/s^2", "deg/s"),
    ),
    "French, of axes": (
        ["temps_ms", *three("acc _"), "vitesse de roulis", "vitesse de tangage", "vitesse de lacet", "T_capteur"],
        (1e-3, G, 1.0), ("ms", "g", "rad/s"),
    ),
    "Spanish": (
        ["Tiempo [s]", *three("Aceleración _ [g]"), *three("Velocidad angular _ [grados/s]"), "Temperatura"],
        (1.0, G, DEGREE), ("s", "g", "deg/s"),
    ),
    "Italian": (
        ["Tempo_s", *three("Accelerazione _ mg"), *three("Velocità angolare _ [gradi/s]"), "Temperatura_scheda"],
        (1.0, G / 1000, DEGREE), ("s", "mg", "deg/s"),
    ),
}  # fmt: skip


def _gyros(header, units):
    """In the header's order: yaw first where it begins with it."""
    columns = (GYRO / units[2]).T
    return columns[::-1] if header[4] == "Gierrate" else columns


def written(header, units, *, encoding="utf-8"):
    """Semicolons between fields, commas in numbers."""
    columns = [TIME / units[0], *(ACCEL / units[1]).T, *_gyros(header, units), TEMPERATURE, STEP]
    names = ";".join([*header, "Prüfschritt"])
    rows = "\n".join(
        ";".join(f"{v:.9g}" for v in row).replace(".", ",") for row in zip(*columns, strict=True)
    )
    return f"{names}\n{rows}\n".encode(encoding)


@pytest.mark.parametrize("language", HEADERS)
def test_names_units_and_decimal_commas(tmp_path, language):
    header, units, said_units = HEADERS[language]
    (tmp_path / "log.csv").write_bytes(written(header, units))
    found = draft_campaign(tmp_path / "log.csv", tmp_path)
    (tmp_path / "campaign.toml").write_text(found.text)
    columns = tomllib.loads(found.text)["columns"]
    assert tuple(columns[k]["unit"] for k in ("time", "accel", "gyro")) == said_units
    assert columns["temperature"] == {"name": header[7], "unit": "degC"}
    (read,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(read.time - read.time[0], TIME, atol=1e-6)
    np.testing.assert_allclose(read.accel, ACCEL, atol=1e-6)
    np.testing.assert_allclose(read.gyro, GYRO, atol=1e-6)


def test_a_spreadsheet_s_encoding_is_read(tmp_path):
    header, units, _ = HEADERS["German, of a vehicle"]
    (tmp_path / "log.csv").write_bytes(written(header, units, encoding="cp1252"))
    columns = tomllib.loads(draft_campaign(tmp_path / "log.csv", tmp_path).text)["columns"]
    assert columns["accel"]["names"][0] == "Längsbeschleunigung [m/s²]"
    assert columns["gyro"]["unit"] == "deg/s"


def test_columns_that_no_line_reads_are_said_and_labels_told_apart(tmp_path):
    header, units, _ = HEADERS["German"]
    text = written(header, units).decode().splitlines()
    lines = [f"{text[0]};Bediener;Spannung", *(f"{line};Müller;5,01" for line in text[1:])]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    text = draft_campaign(tmp_path / "log.csv", tmp_path).text
    assert '# Not read, perhaps labels: "Bediener", "Prüfschritt". Add what they are' in text
    assert '# Not read: "Spannung".' in text and "table_angles" not in text


def test_a_table_s_angles_are_said_to_make_references(tmp_path):
    header, units, _ = HEADERS["German"]
    text = written(header, units).decode().splitlines()
    lines = [f"{text[0]};Winkel aussen", *(f"{line};{k},25" for k, line in enumerate(text[1:]))]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    text = draft_campaign(tmp_path / "log.csv", tmp_path).text
    assert "make its references: [columns] table_angles, and [table] axes" in text


def test_devices_and_experiments_under_their_words(tmp_path):
    header, units, _ = HEADERS["German"]
    text = written(header, units).decode().splitlines()
    head = text[0].replace("Prüfschritt", "Versuch")
    lines = [f"{head};Seriennummer", *(f"{line};A-17" for line in text[1:])]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    found = draft_campaign(tmp_path / "log.csv", tmp_path)
    (tmp_path / "campaign.toml").write_text(found.text)
    assert "Not read" not in found.text
    (read,) = load_campaign(tmp_path).recordings
    assert read.device == "A-17"
    np.testing.assert_array_equal(read.experiment, STEP.astype(int))


def test_angles_called_roll_pitch_yaw_are_no_rates():
    """Only with a word for a rate; p, q and r are rates as they stand."""
    assert triads_by_name(("roll", "pitch", "yaw", "time")) == []
    assert triads_by_name(("Gierrate", "Nickrate", "Rollrate")) == [
        ("Rollrate", "Nickrate", "Gierrate")
    ]
    assert triads_by_name(("q", "r", "p")) == [("p", "q", "r")]
    assert triads_by_name(("p_bar", "q_bar", "r_bar")) == []


@pytest.mark.parametrize("behind", ["_degs", "_deg_s", "_dps", "_degps", " deg_per_s", " [deg/s]"])
def test_p_q_r_are_rates_with_a_unit_behind_them_too(tmp_path, behind):
    header = [f"{letter}{behind}" for letter in "pqr"]
    columns = [TIME, *(ACCEL / 9.80665).T, *np.degrees(GYRO).T]
    rows = "\n".join(",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True))
    (tmp_path / "log.csv").write_text(
        f"{','.join(['t_s', 'ax_g', 'ay_g', 'az_g', *header])}\n{rows}\n"
    )
    columns = tomllib.loads(draft_campaign(tmp_path / "log.csv", tmp_path).text)["columns"]
    assert columns["gyro"] == {"names": header, "unit": "deg/s"}


@pytest.mark.parametrize(
    "units, hint, unit",
    [
        (RATE_UNITS, "drehrate_x [grad/s]", "deg/s"),
        (RATE_UNITS, "drehrate_x [rad/s]", "rad/s"),
        (RATE_UNITS, "Drehrate in Grad/h", "deg/h"),
        (RATE_UNITS, "gyro_x_degh", "deg/h"),
        (RATE_UNITS, "vitesse angulaire x (degrés/s)", "deg/s"),
        (TIME_UNITS, "Zeit in Millisekunden", "ms"),
        (TIME_UNITS, "tiempo (segundos)", "s"),
        (TIME_UNITS, "temps_us", "us"),
        (TIME_UNITS, "Zeit", None),
    ],
)
def test_units_in_words(units, hint, unit):
    assert said(units, hint) == unit


def test_the_stamp_of_a_message_comes_before_the_time_of_its_recording(tmp_path):
    """`rostopic echo -p` writes both; `%time` is when the message was recorded."""
    stamp = (1.7e18 + 1e9 * TIME).astype(np.int64)
    late = stamp + np.random.default_rng(3).integers(0, 15_000_000, len(stamp))
    names = [
        "%time",
        "field.header.seq",
        "field.header.stamp",
        *(f"field.angular_velocity.{a}" for a in "xyz"),
    ]
    names += [f"field.linear_acceleration.{a}" for a in "xyz"]
    rows = zip(np.sort(late), range(len(stamp)), stamp, *GYRO.T, *ACCEL.T, strict=True)
    text = "\n".join([",".join(names), *(",".join(map(str, r)) for r in rows)])
    (tmp_path / "imu.csv").write_text(text)
    columns = tomllib.loads(draft_campaign(tmp_path / "imu.csv", tmp_path).text)["columns"]
    assert columns["time"] == {"name": "field.header.stamp", "unit": "ns"}
