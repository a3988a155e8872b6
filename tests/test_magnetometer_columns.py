"""Magnetometer columns of a log: what `init` makes of them, what `check` says of their unit, and gaps."""

import numpy as np
import pytest

from inertiax.campaign_draft.mag_unit import mag_unit
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording
from inertiax.plausibility import check_campaign
from magnetometer_cases import FIELD, HARD, slow_turns, SOFT


def _outputs(rows=400):
    rng = np.random.default_rng(6)
    turns = slow_turns(rows, rng)
    mag = turns @ (FIELD * np.array([0.44, 0.0, -0.9])) @ (np.eye(3) + SOFT).T + HARD
    return 9.81 * turns[:, :, 2] + 0.01 * rng.normal(size=(rows, 3)), mag


@pytest.mark.parametrize(
    "unit, factor", [("uT", 1e6), ("gauss", 1e4), ("mgauss", 1e7), ("nT", 1e9)]
)
def test_the_unit_is_told_by_the_field(unit, factor):
    assert mag_unit(factor * _outputs()[1]) == unit


def test_a_device_that_is_not_turned_does_not_tell_it():
    still = 48.0 + 0.1 * np.random.default_rng(1).normal(size=(400, 3))
    assert mag_unit(still) is None


def _log(folder, names, scale):
    force, mag = _outputs()
    path = folder / "log.csv"
    lines = [f"time,ax,ay,az,{','.join(names)}"]
    for k, (a, m) in enumerate(zip(force, scale * mag, strict=True)):
        field = ",".join(f"{x:.4f}" for x in m) if k % 4 == 0 else ",,"
        lines.append(f"{0.02 * k:.2f},{','.join(f'{x:.4f}' for x in a)},{field}")
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def test_init_names_the_columns_and_gaps_are_read(tmp_path):
    path = _log(tmp_path, ("mx", "my", "mz"), 1e6)
    found = draft_campaign(path, tmp_path)
    assert 'mag = { names = ["mx", "my", "mz"], unit = "uT" }' in found.text
    (tmp_path / "campaign.toml").write_text(found.text, "utf-8")
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.mag is not None
    read = np.isfinite(recording.mag).all(axis=1)
    assert read.sum() == 100
    # Four digits of a microtesla.
    assert np.allclose(recording.mag[read], _outputs()[1][::4], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    "name, unit, scale", [("m{}_mG", "mgauss", 1e7), ("m{}_G", "gauss", 1e4), ("B{}_uT", "uT", 1e6)]
)
def test_a_unit_behind_the_axis_is_no_part_of_the_name(tmp_path, name, unit, scale):
    names = tuple(name.format(a) for a in "xyz")
    found = draft_campaign(_log(tmp_path, names, scale), tmp_path)
    listed = ", ".join(f'"{n}"' for n in names)
    assert f'mag = {{ names = [{listed}], unit = "{unit}" }}' in found.text


def test_columns_of_that_name_that_hold_no_numbers_are_left_alone(tmp_path):
    path = _log(tmp_path, ("mag_x", "mag_y", "mag_z"), 1e6)
    path.write_text(path.read_text("utf-8").replace(",,", ",none,none"), "utf-8")
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
        '[columns]\naccel = { names = ["ax", "ay", "az"] }\n',
        "utf-8",
    )
    assert load_campaign(tmp_path).recordings[0].mag is None


@pytest.mark.parametrize("factor, unit", [(1e6, "uT"), (1e4, "gauss")])
def test_check_names_a_wrong_unit(factor, unit):
    force, mag = _outputs()
    # As a reader gives it; `from_arrays` would refuse it.
    recording = Recording(time=0.02 * np.arange(400.0), accel=force, mag=factor * mag)
    found = [f for f in check_campaign(Campaign((recording,))).findings if f.kind == "mag_unit"]
    assert [f.severity for f in found] == ["warning"]
    assert found[0].remedy == f'[columns]\nmag = {{ unit = "{unit}" }}'


def test_check_is_content_with_tesla():
    force, mag = _outputs()
    recording = Recording.from_arrays(sample_rate=50.0, accel=force, mag=mag)
    assert not [f for f in check_campaign(Campaign((recording,))).findings if f.what == "mag"]
