"""A bias that follows the supply voltage, from a file's column to the corrected recording; data from plain NumPy."""

import json

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from inertiax.calibration.calibration import read_calibration
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.pipeline import run_diagnosis
from inertiax.exports.compensated_recording import compensate_recording


G = 9.81
PER_VOLT = 2e-3  # m/s²/V, of accel_y
CAMPAIGN = """
[site]
gravity = 9.81
[recordings]
files = ["*.csv"]
[columns]
supply = { name = "vcc", unit = "mV" }
[rig]
position_uncertainty = 2.0
[device]
grade = "consumer"
[model]
accel_estimator = "reference"
temperature_degree = 0
"""


SAID = 'supply = { name = "vcc", unit = "mV" }\n'


def log(seed=0, rounds=4, rest=12):
    """Tumbles of twelve positions; the supply wanders by a tenth of a volt and is told in millivolts."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(4) / 4
    eye = np.eye(3)
    ups = [
        np.cos(a) * eye[i] + np.sin(a) * eye[j] for i, j in ((0, 1), (1, 2), (2, 0)) for a in turn
    ]
    order = np.concatenate([rng.permutation(12) for _ in range(rounds)])
    up = np.repeat(np.array(ups)[order], rest, axis=0)
    num = len(up)
    supply = 5.0 + 0.1 * np.sin(2 * np.pi * np.arange(num) / 97.0)
    output = G * up @ (np.eye(3) + 1e-3 * rng.standard_normal((3, 3))).T + 0.02
    output += 2e-4 * rng.standard_normal((num, 3))
    output[:, 1] += PER_VOLT * (supply - 5.0)
    columns = {"time": np.arange(num) * 1.0}
    for k, axis in enumerate("xyz"):
        columns |= {f"accel_{axis}": output[:, k], f"reference_accel_{axis}": G * up[:, k]}
    step = np.arange(num) % rest
    columns["position"] = np.where(step < 2, -1, np.repeat(order, rest))
    return pl.DataFrame({**columns, "vcc": 1e3 * supply})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("supply")
    (made / "campaign.toml").write_text(CAMPAIGN)
    log().write_csv(made / "tumble.csv")
    return made


@pytest.fixture(scope="module")
def diagnosed(folder):
    out = folder.parent / "supply-diagnosis"
    run_diagnosis(folder, out)
    return out


def test_millivolts_become_volts(folder):
    (recording,) = load_campaign(folder).recordings
    assert recording.supply.min() == pytest.approx(4.9, abs=1e-3)
    assert recording.supply.max() == pytest.approx(5.1, abs=1e-3)


def test_an_unknown_unit_is_refused_with_the_known_ones(folder, tmp_path):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace('"mV"', '"kV"'))
    log().write_csv(tmp_path / "tumble.csv")
    with pytest.raises(ValueError, match=r"\[columns\] supply: unit 'kV' is not known; .*V, mV"):
        load_campaign(tmp_path)


def test_a_column_of_that_name_with_words_is_left_alone(tmp_path):
    (tmp_path / "campaign.toml").write_text(
        CAMPAIGN.split("[columns]")[0] + '[device]\ngrade = "consumer"\n'
    )
    table = log().drop("vcc").with_columns(supply=pl.lit("battery"))
    table.write_csv(tmp_path / "tumble.csv")
    assert load_campaign(tmp_path).recordings[0].supply is None


def test_an_array_of_that_name_that_nobody_asked_for_is_left_alone(tmp_path):
    (tmp_path / "campaign.toml").write_text(
        CAMPAIGN.split("[columns]")[0].replace("*.csv", "*.mat") + '[device]\ngrade = "consumer"\n'
    )
    table = log()
    arrays = {name: table[name].to_numpy() for name in table.columns if name != "vcc"}
    savemat(tmp_path / "tumble.mat", {**arrays, "supply": np.arange(3.0)})  # another length
    assert load_campaign(tmp_path).recordings[0].supply is None


def test_a_voltage_that_only_some_recordings_tell_is_not_tested(tmp_path):
    told, untold = (load(log(seed), tmp_path / str(seed), seed == 0) for seed in (0, 1))
    assert told.supply is not None and untold.supply is None
    campaign = load_campaign(tmp_path / "0")
    both = Campaign((told, untold), campaign.site, campaign.rig, campaign.model, "consumer")
    assert join(both).supply is None
    assert join(campaign).supply is not None


def load(table, folder, with_voltage):
    """The one recording of a campaign written to a folder."""
    folder.mkdir()
    asked = CAMPAIGN if with_voltage else CAMPAIGN.replace(SAID, "")
    (folder / "campaign.toml").write_text(asked)
    (table if with_voltage else table.drop("vcc")).write_csv(folder / "tumble.csv")
    (recording,) = load_campaign(folder).recordings
    return recording


@pytest.mark.slow
def test_the_sensitivity_is_named_and_sized(diagnosed):
    (effect,) = json.loads((diagnosed / "diagnosis.json").read_text())["effects"]
    assert (effect["name"], effect["channels"]) == ("supply", ["accel_y"])
    found = effect["parameters"]["coefficient"]
    assert found["unit"] == "m/s^2/V"
    assert abs(found["value"] - PER_VOLT) < 4 * found["std"] < 0.5 * PER_VOLT


@pytest.mark.slow
def test_another_recording_at_another_voltage_is_corrected(diagnosed, tmp_path):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    other = log(seed=0, rounds=2)
    lower = pl.col("vcc") - 200.0
    drop = pl.col("accel_y") - 0.2 * PER_VOLT
    other.with_columns(vcc=lower, accel_y=drop).write_csv(tmp_path / "tumble.csv")
    (recording,) = load_campaign(tmp_path).recordings
    calibration = read_calibration(diagnosed / "calibration.json")
    force = compensate_recording(calibration, recording)[0]
    rest = recording.position >= 0
    off = (force - recording.reference_accel)[rest].mean(axis=0)
    # 0.4 mm/s² would be left on y without the effect; white noise of 240 samples leaves 0.013.
    assert np.abs(off).max() < 1e-4
