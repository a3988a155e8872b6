"""A device that no column names: its serial number from `campaign.toml`, or from the station of a protocol."""

import numpy as np
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Recording, restated
from inertiax.protocol import content
from inertiax.protocol.identity import identity, not_stated
from inertiax.protocol.measurement import Measurement
from inertiax.protocol.protocol import make_protocol
from inertiax.protocol.station import read_station
from protocol_cases import write_campaign
from protocol_effect_cases import measured


def _with_serial(folder, serial: str):
    file = folder / "campaign.toml"
    file.write_text(f'{file.read_text()}[device]\nserial = "{serial}"\n')
    return folder


def test_a_campaign_names_its_device(tmp_path):
    campaign = load_campaign(_with_serial(write_campaign(tmp_path / "c"), "7F-0231"))
    assert campaign.devices == ("7F-0231",)
    in_parts = load_campaign(tmp_path / "c", in_parts=True)
    assert in_parts.of_device("7F-0231").recordings[0].num_samples == 840


def test_a_column_that_names_another_device_is_refused(tmp_path):
    home = _with_serial(write_campaign(tmp_path / "c", ("A", "B")), "A")
    with pytest.raises(ValueError, match=r"\[device\] serial = 'A', but a column .* names 'B'"):
        load_campaign(home)
    home = _with_serial(write_campaign(tmp_path / "d", ("A",)), "A")
    assert load_campaign(home).devices == ("A",)
    home = _with_serial(write_campaign(tmp_path / "e"), " ")
    with pytest.raises(ValueError, match=r"\[device\] serial is empty"):
        load_campaign(home)


def test_a_renamed_recording_keeps_its_columns():
    time = np.arange(5.0)
    one = Recording(time=time, accel=np.ones((5, 3)), name="log")
    other = restated(one, device="X")
    assert (one.device, other.device, other.name) == ("", "X", "log")
    assert other.time is one.time and np.array_equal(other.accel, one.accel)


def test_the_station_names_a_device_without_a_name(tmp_path):
    file = tmp_path / "station.toml"
    file.write_text('[device]\nserial = "7F-0231"\n')
    made = make_protocol(measured(""), read_station(file))
    assert made.document()["device"] == "7F-0231"
    assert content.title(made) == "Calibration protocol of 7F-0231"
    with pytest.raises(ValueError, match="of device 'SN7', but the station's .* is '7F-0231'"):
        make_protocol(measured("SN7"), read_station(file))
    unnamed = make_protocol(measured(""), read_station(_empty(tmp_path)))
    said = dict(identity(unnamed).tables[0].rows)["device"]
    assert said.startswith("not named; [device] serial")
    assert isinstance(measured(""), Measurement)


def test_what_nobody_stated_is_said_with_the_file_that_states_it(tmp_path):
    unnamed = make_protocol(measured(""), read_station(_empty(tmp_path)))
    assert not_stated(unnamed) == (
        "Not stated: device; manufacturer, model; station; operator; days of the measurement. --station FILE states "
        "them in [station] and [device]."
    )
    file = tmp_path / "station.toml"
    file.write_text(
        '[station]\nname = "Hall C"\noperator = "A. Example"\nbegin = "2026-01-30"\n'
        '[device]\nserial = "7F-0231"\n'
    )
    said = not_stated(make_protocol(measured(""), read_station(file)))
    assert said is not None and said.startswith("Not stated: manufacturer, model. --station")
    file.write_text(file.read_text() + 'model = "M1"\n')
    assert not_stated(make_protocol(measured(""), read_station(file))) is None


def _empty(folder):
    (folder / "empty.toml").write_text("")
    return folder / "empty.toml"
