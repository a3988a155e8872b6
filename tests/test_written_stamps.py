"""Days and hours as stations and spreadsheets write them, against the standard library's `strftime`."""

from datetime import datetime, timedelta, UTC

import numpy as np
import polars as pl
import pytest

from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.time_stamps import is_stamp, seconds_of


START = datetime(2026, 11, 23, 11, 59, 58, 500_000, tzinfo=UTC)
MIDNIGHT = datetime(2026, 3, 4, 23, 59, 59, tzinfo=UTC)


def moments(start, count=8, step=0.5):
    return [start + timedelta(seconds=step * k) for k in range(count)]


def read(written):
    return seconds_of(pl.Series(written), "log.csv")


FORMS = {
    "LabVIEW and Excel in the US": "%m/%d/%Y %I:%M:%S.%f %p",
    "India and Australia": "%d/%m/%Y %I:%M:%S.%f %p",
    "Britain and France": "%d/%m/%Y %H:%M:%S.%f",
    "two digits a year": "%m/%d/%y %H:%M:%S.%f",
    "Germany": "%d.%m.%y %H:%M:%S,%f",
    "a browser": "%m/%d/%Y, %I:%M:%S.%f\u202f%p",
    "MATLAB's datestr": "%d-%b-%Y %H:%M:%S.%f",
    "a month's whole name": "%B %d, %Y %I:%M:%S.%f %p",
    "China": "%Y/%m/%d 上午 %I:%M:%S.%f",
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_seconds_are_those_of_the_standard_library(form):
    before_noon = [m for m in moments(START) if "上午" not in form or m.hour < 12]
    written = [m.strftime(form) for m in before_noon]
    assert all(is_stamp(text) for text in written)
    np.testing.assert_allclose(
        read(written), [m.timestamp() for m in before_noon], rtol=0.0, atol=2.4e-7
    )


@pytest.mark.parametrize("form", ["%m/%d/%Y %I:%M:%S %p", "%d/%m/%Y %H:%M:%S", "%d-%m-%y %H:%M:%S"])
def test_days_that_follow_one_another_tell_day_from_month(form):
    passing = moments(MIDNIGHT)
    found = read([m.replace(microsecond=0).strftime(form) for m in passing])
    np.testing.assert_array_equal(found, [m.replace(microsecond=0).timestamp() for m in passing])


def test_a_date_that_may_be_two_is_left_open():
    noon = moments(datetime(2026, 3, 4, 11, 59, 59, tzinfo=UTC))
    found = read([m.strftime("%m/%d/%Y %I:%M:%S.%f %p") for m in noon])
    np.testing.assert_allclose(found, 43199.0 + 0.5 * np.arange(8), atol=1e-9)
    # The same day and month in both orders, which is one date.
    assert read(["3/3/2026 12:00:00 AM"])[0] == datetime(2026, 3, 3, tzinfo=UTC).timestamp()


def test_hours_of_half_a_day_begin_with_twelve():
    assert read(["12:00:00 AM", "1:00:00 a.m.", "12:00:00 pm", "11:59:00 PM"]).tolist() == [
        0.0,
        3600.0,
        43200.0,
        86340.0,
    ]


@pytest.mark.parametrize("between", ["--", "-", "_", "T", " "])
def test_dashes_between_all_numbers(between):
    """As a ground station for rockets writes them: 2024-3-23--13-41-38-830, milliseconds without zeros before them."""
    passing = moments(datetime(2026, 3, 4, 23, 59, 58, 5000, tzinfo=UTC), 40, 0.155)
    written = [
        f"{m.year}-{m.month}-{m.day}{between}{m.hour}-{m.minute}-{m.second}-{m.microsecond // 1000}"
        for m in passing
    ]
    assert all(is_stamp(text) for text in written)
    np.testing.assert_allclose(read(written), [m.timestamp() for m in passing], atol=2.4e-7)
    whole = [f"2026-03-04{between}23-59-{s:02d}" for s in (58, 59)]
    np.testing.assert_array_equal(np.diff(read(whole)), [1.0])


def test_minutes_that_a_spreadsheet_left_begin_anew_each_hour():
    np.testing.assert_allclose(read(["59:59.5", "00:00.0", "0:00.5"]), [3599.5, 3600.0, 3600.5])


def test_hours_and_minutes_alone_are_a_time_of_day():
    assert read(["23:59", "00:00"]).tolist() == [86340.0, 86400.0]


@pytest.mark.parametrize(
    "label",
    [
        "3_10",
        "1:5",
        "12-41-38",
        "10-20-30-40",
        "1-555-010-9999",
        "12/11/2026",
        "pose 1",
        "AM",
        "1.2.3",
        "x",
    ],
)
def test_what_is_no_time_is_none(label):
    assert not is_stamp(label)
    assert read([label, label]) is None


@pytest.mark.parametrize(
    "rows, message",
    [
        (["2/30/2026 9:00:00 AM"], "'2/30/2026 9:00:00 AM' in row 0, which is no day"),
        (["31.01.2026 9:00:00", "32.01.2026 9:00:00"], "row 1, where a stamp like '31.01.2026"),
        (["10:00:00", "x"], "'x' in row 1, where a stamp like '10:00:00'"),
        (["00:00.5", "10"], "'10' in row 1, where a stamp like '00:00.5'"),
        (["1/1/1626 10:00:00"], "which is no day"),
        (["2026-3-4--10-00-00-5", "2026-3-4--10-00"], "row 1, where a stamp like"),
    ],
)
def test_a_row_that_is_none_is_named(rows, message):
    with pytest.raises(ValueError, match=message):
        read(rows)


def test_a_us_station_and_its_chamber_are_drafted_on_one_clock(tmp_path):
    rng = np.random.default_rng(2)
    up = np.repeat(rng.standard_normal((14, 3)), 40, axis=0)
    accel = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    accel += 1e-3 * rng.standard_normal(accel.shape)
    when = moments(datetime(2026, 11, 23, 23, 59, 50, tzinfo=UTC), len(accel), 0.05)
    write = lambda m: f"{m:%m/%d/%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}"
    (tmp_path / "imu.csv").write_text(
        "Timestamp,ax (m/s^2),ay (m/s^2),az (m/s^2)\n"
        + "".join(
            f"{write(m)},{a[0]:.5f},{a[1]:.5f},{a[2]:.5f}\n"
            for m, a in zip(when, accel, strict=True)
        )
    )
    readings = [when[0] + timedelta(seconds=s) for s in range(-5, 40, 5)]
    (tmp_path / "chamber.csv").write_text(
        "Time,Temperature (C)\n"
        + "".join(f"{m:%m/%d/%Y %I:%M:%S %p},{20 + k}\n" for k, m in enumerate(readings))
    )
    draft = draft_campaign(tmp_path / "imu.csv", tmp_path, temperature=tmp_path / "chamber.csv")
    (tmp_path / "campaign.toml").write_text(draft.text)
    assert "temperature_delay" not in draft.untold
    recording = load_campaign(tmp_path).recordings[0]
    np.testing.assert_allclose(np.diff(recording.time), 0.05, atol=1e-6)
    assert recording.time[0] == when[0].timestamp()
    # A kelvin in 5 s, 21 °C at the log's first row.
    expected = 21.0 + 0.2 * (recording.time - recording.time[0])
    np.testing.assert_allclose(np.ravel(recording.temperature), expected, atol=1e-5)
