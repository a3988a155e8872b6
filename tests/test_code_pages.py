"""Logs of station programs that write in the code page of their language, not in UTF-8."""

import tomllib

import numpy as np
import pytest

from hand_log_data import DEGREE, G, hand_log
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.code_pages import code_page
from inertiax.data.formats.text_layout import as_utf8


TIME, ACCEL, GYRO = hand_log()
# Settings above the names; the names of time, accelerometers, gyros and temperature; units in a line or in the names.
STATIONS = {
    "cp932": (
        '"機種名","恒温槽付2軸レートテーブル"\n"備考",""',
        "時間[s],加速度X[G],加速度Y[G],加速度Z[G],角速度X[deg/s],角速度Y[deg/s],角速度Z[deg/s],素子温度[℃]",
    ),
    "gb18030": (
        "设备编号,转台",
        "时间(s),加速度X(g),加速度Y(g),加速度Z(g),角速度X(deg/s),角速度Y(deg/s),角速度Z(deg/s),温度(℃)",
    ),
    "cp949": (
        "장비,레이트 테이블",
        "시간(s),가속도X(g),가속도Y(g),가속도Z(g),각속도X(deg/s),각속도Y(deg/s),각속도Z(deg/s),온도(℃)",
    ),
    "cp1251": (
        "Стенд,двухосный",
        "Время (с),Ускорение X (g),Ускорение Y (g),Ускорение Z (g),Угловая скорость X (°/с),"
        "Угловая скорость Y (°/с),Угловая скорость Z (°/с),Температура (°C)",
    ),
}


@pytest.mark.parametrize("page", STATIONS)
def test_a_station_s_log_is_read_in_its_own_code_page(tmp_path, page):
    settings, names = STATIONS[page]
    rows = np.column_stack([TIME, ACCEL / G, GYRO / DEGREE, 20.0 + TIME / 60.0])
    lines = [settings, names, *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    (tmp_path / "log.csv").write_bytes("\r\n".join(lines).encode(page))
    text = draft_campaign(tmp_path / "log.csv", tmp_path).text
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    columns = tomllib.loads(text)["columns"]
    header = names.split(",")
    assert columns["accel"]["names"] == header[1:4]
    assert columns["gyro"] == {"names": header[4:7], "unit": "deg/s"}
    assert columns["temperature"] == {"name": header[7], "unit": "degC"}
    (read,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(read.accel, ACCEL, atol=1e-6)
    np.testing.assert_allclose(read.gyro, GYRO, atol=1e-6)


WESTERN = (
    "Zeit [s];Längsbeschleunigung [m/s²];Größe;Übergänge;T_Gehäuse [°C]",
    "Temps (s),Accélération créée,Vitesse angulaire (°/s),Température relevée – n° 3",
    "Aceleración «X»,Velocità angolare,‘x’ “X”,år,måleværdi",
    "€,…,‰,µg",
)


@pytest.mark.parametrize("line", WESTERN)
def test_western_letters_stay_what_they_are(line):
    text = line.encode("cp1252")
    assert code_page(text) == "cp1252"
    assert as_utf8(text, code_page(text)).decode() == line


def test_a_long_text_is_told_by_its_first_lines_and_utf_8_stays():
    names = STATIONS["cp932"][1]
    text = f"{names}\n".encode("cp932") + b"0.00,1.00\n" * 20_000
    assert code_page(text) == "cp932"
    assert code_page(f"{names}\n".encode() * 2000) == "utf-8"  # cut amid a line, not amid a letter
