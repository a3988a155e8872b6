"""No escape sequence that stands in a file reaches standard output or error, wherever the file's text is shown."""

import numpy as np
import polars as pl
import pytest

from bad_inputs_cases import (
    CASES,
    CSV,
    FLEET,
    good_calibration,
    parquet,
    recorded,
    rests,
    scenario,
    SITE,
    TABLE,
    told,
    TOML,
)
from command_runs import place, run_in


# A window's title, a cleared screen, a reversed direction of writing, the one-byte form of escape [, and letters that
# show that the name is what was shown.
EVIL = "\x1b]0;x\x07\x1b[2J\u202eEVIL\x9b31m"
IN_TOML = EVIL.replace("\x1b", "\\u001b").replace("\x07", "\\u0007").replace("\x9b", "\\u009b")
IN_JSON = IN_TOML
DEVICE = TABLE.with_columns(device=pl.lit(EVIL))
SEVERAL = pl.concat([DEVICE, rests(seed=2).with_columns(device=pl.lit("B"))])


def campaign(table: pl.DataFrame, *, toml: str = TOML, name: str = "a.parquet") -> dict:
    content = parquet(table) if name.endswith("parquet") else table.write_csv()
    return {"c/campaign.toml": toml, f"c/{name}": content}


def still() -> pl.DataFrame:
    rng = np.random.default_rng(0)
    accel = [0.0, 0.0, 9.81] + 1e-3 * rng.standard_normal((400, 3))
    columns = {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    return pl.DataFrame({"time": 0.1 * np.arange(400), **columns, "device": [EVIL] * 400})


# By the place that the text stands in and is shown from: a command and its files.
PLACES = {
    "device, calibrated": ("calibrate @c -o @out", campaign(DEVICE)),
    "device, checked": ("check @c", campaign(DEVICE.with_columns(pl.col("^accel.*$") / 9.80665))),
    "device, compensated": (
        "compensate @good.json @c/a.parquet -o @out.csv",
        campaign(SEVERAL),
    ),
    "device, noise": ("noise @c -o @out", campaign(still())),
    "device, in a fleet's folder": (
        "fleet @c -o @out",
        {f"c/{EVIL.replace('/', '')}/campaign.toml": "no TOML", "c/B/campaign.toml": "[x"},
    ),
    "column of CSV": recorded(CSV.replace("accel_y", f"{EVIL}accel_y", 1)),
    "column of Parquet": recorded(parquet(TABLE.rename({"accel_y": EVIL})), name="a.parquet"),
    "column of a log for init": (
        "init @a.csv -o @out",
        {"a.csv": CSV.replace("accel_y", EVIL, 1)},
    ),
    "column named in campaign.toml": told(f'{TOML}[columns]\ntime = "{IN_TOML}"\n'),
    "field of CSV": recorded(CSV.replace("\n0.1,", f"\n{EVIL},", 1)),
    "name of a recording": (
        "calibrate @c -o @out",
        {"c/campaign.toml": TOML.replace("a.*", "*"), f"c/{EVIL}.csv": "a,b\n1,2\n"},
    ),
    "name of a campaign's folder": (
        "check @c",
        {"c/campaign.toml": TOML.replace("a.*", IN_TOML)},
    ),
    "key of campaign.toml": told(f'{SITE}"{IN_TOML}" = 1\n[recordings]\nfiles = ["a.*"]\n'),
    "unit in campaign.toml": told(f'{TOML}[columns]\naccel = {{ unit = "{IN_TOML}" }}\n'),
    "grade in campaign.toml": told(f'{TOML}[device]\ngrade = "{IN_TOML}"\n'),
    "estimator in campaign.toml": told(f'{TOML}[model]\naccel_estimator = "{IN_TOML}"\n'),
    "key of [model] in campaign.toml": told(f'{TOML}[model]\n"{IN_TOML}" = 1\n'),
    "glob in campaign.toml": told(SITE + f'[recordings]\nfiles = ["{IN_TOML}*"]\n'),
    "key of a scenario": scenario(f'[plan]\n"{IN_TOML}" = 1\n'),
    "value of a scenario": scenario(f'[plan]\nprogramme = "{IN_TOML}"\n'),
    "schema of a calibration": (
        "compensate @c.json @good.csv -o @out.csv",
        {"c.json": good_calibration(thermal=False, schema=EVIL)},
    ),
    "key of a calibration": (
        "export @c.json --to c -o @out.h",
        {"c.json": good_calibration(thermal=False, **{EVIL: 1})},
    ),
    "basis of a calibration": (
        "compensate @c.json @good.csv -o @out.csv",
        {"c.json": good_calibration(accel__basis__kind=EVIL)},
    ),
    "schema of a prior": (
        "fleet @c -o @out --prior @p.json",
        {**FLEET, "p.json": f'{{"schema": "{IN_JSON}"}}'},
    ),
    "parameter of another tool's file": (
        "export @a.txt --from px4 --to inertiax",
        {"a.txt": f"1\t1\tCAL_ACC0_XOFF\t{EVIL}\t9\n"},
    ),
    "requirement of a protocol": (
        "protocol @c -o @out --requirements @r.toml",
        {"c/calibration.json": good_calibration(thermal=False),
         "r.toml": f'[requirements]\n"accel.bias" = "{IN_TOML}"\n'},
    ),
    "station of a protocol": (
        "protocol @c -o @out --station @s.toml",
        {"c/calibration.json": good_calibration(thermal=False),
         "s.toml": f'[station]\n"{IN_TOML}" = 1\n'},
    ),
    "log that live follows": (
        "live @c --follow @a.csv --idle 0.1 -o @out",
        {"c/campaign.toml": TOML, "a.csv": f"time,{EVIL},b,c\n" + "1,2,3,4\n" * 60},
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", PLACES)
def test_no_escape_sequence_passes(name, tmp_path, capfd, monkeypatch):
    arguments, files = PLACES[name]
    place(tmp_path, {"good.json": good_calibration(thermal=False), "good.csv": CSV, **files})
    _, out, err = run_in(arguments, tmp_path, capfd, monkeypatch)
    assert "EVIL" in out + err
    assert all(c.isprintable() or c == "\n" for c in out + err), out + err


def test_there_are_places_enough():
    assert len(PLACES) >= 20 and "terminal codes in a name" in CASES
