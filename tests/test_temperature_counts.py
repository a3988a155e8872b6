"""Raw counts of a temperature probe: the data sheet's formula by scale and offset, in both readers."""

from pathlib import Path

import numpy as np
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.data.formats.columns import ProbeColumns, temperature_factors


COUNTS = np.array([-2220, -2000, -12420, 0])
MPU6050 = COUNTS / 340.0 + 36.53  # the data sheet's formula, °C


def _campaign(folder: Path, temperature: str) -> Path:
    rows = [f"{0.1 * k},0,0,9.8,{c}" for k, c in enumerate(COUNTS)]
    (folder / "a.csv").write_text("\n".join(["time,accel_x,accel_y,accel_z,t", *rows]))
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = 9.8\n[recordings]\nfiles = ["a.csv"]\n[columns]\ntemperature = {temperature}\n'
    )
    return folder


@pytest.mark.parametrize(
    "keys",
    [
        'scale = 340, scale_unit = "count per degC"',
        "scale = 0.0029411764705882353",
        'scale = 0.0029411764705882353, scale_unit = "degC per count"',
    ],
)
def test_counts_become_degrees(tmp_path, keys):
    said = f'{{ name = "t", unit = "count", {keys}, offset = -12420.2 }}'
    (recording,) = load_campaign(_campaign(tmp_path, said)).recordings
    assert recording.temperature is not None
    np.testing.assert_allclose(recording.temperature[:, 0], MPU6050, atol=1e-9)


def test_factors_are_those_of_the_formula():
    scale, shift = temperature_factors(ProbeColumns(unit="count", scale=0.25, offset=100.0), "here")
    assert scale * (140.0 + shift) == 10.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('unit = "count"', "needs scale"),
        ('unit = "count", scale = 0', "needs scale"),
        ("scale = 2.0", "scale belongs to raw counts, but unit is 'degC'"),
        ('unit = "count", scale = 1.0, scale_unit = "g per count"', "is not understood"),
        ('unit = "kelvin"', "use one of degC, °C, K, degF, °F, count"),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, keys, said):
    with pytest.raises(ValueError, match="temperature") as caught:
        load_campaign(_campaign(tmp_path, f'{{ name = "t", {keys} }}'))
    assert said in str(caught.value)
