"""A log compensated in pieces is what the whole table gives, and bad input ends in the same line."""

from dataclasses import replace

import jax
import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.calibration.over_rows import compensated_rows
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import parquet, text_batches
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.compensated_stream import write_compensated
from inertiax.exports.text_columns import KINDS, kinds_of, TextKinds, typed
from inertiax.physics.temperature import Constant, Curve, Polynomial


ROWS = 700
SIZE = 9000  # bytes: a dozen pieces of the text below
GRAVITY = 9.81


def calibration(*effects: FittedEffect) -> Calibration:
    """Both triads, linear in temperature from 10 to 30 °C."""
    basis = Polynomial(1, 10.0, 30.0)
    rng = np.random.default_rng(3)
    made = []
    for triad in ("accel", "gyro"):
        names = (
            *(f"{triad}.bias[{i}]" for i in range(3)),
            *(f"{triad}.matrix[{i},{j}]" for i in range(3) for j in range(3)),
        )
        curve = Curve(basis, 0.01 * rng.standard_normal((2, 12)))
        made.append(TriadCalibration(curve, np.zeros((24, 24)), names, "reference"))
    return Calibration(
        gravity=GRAVITY,
        accel=made[0],
        gyro=made[1],
        temperature_range=(10.0, 30.0),
        effects=effects,
    )


def log() -> pl.DataFrame:
    rng = np.random.default_rng(5)
    columns = {"time": 0.01 * np.arange(ROWS)}
    columns |= {f"{t}_{a}": rng.standard_normal(ROWS) for t in ("accel", "gyro") for a in "xyz"}
    columns |= {"temperature": np.linspace(15.0, 35.0, ROWS), "count": np.arange(ROWS)}
    return pl.DataFrame(columns).with_columns(
        empty=pl.Series([None] * ROWS, dtype=pl.String),
        remark=pl.Series([f"r{k}, said" for k in range(ROWS)]),
        # Whole numbers at first, then halves, then text: each kind in pieces of its own.
        late=pl.Series([f"{k}" if k < 300 else f"{k}.5" for k in range(ROWS)]),
        words=pl.Series([f"{k}" if k < 500 else "none" for k in range(ROWS)]),
    )


@pytest.mark.parametrize("target", ["out.csv", "out.parquet"])
@pytest.mark.parametrize("source", ["a.csv", "a.parquet"])
def test_pieces_give_the_whole_table(tmp_path, source, target, monkeypatch):
    write = pl.DataFrame.write_csv if source.endswith("csv") else pl.DataFrame.write_parquet
    write(log(), tmp_path / source)
    whole = compensate_file(calibration(), tmp_path / source)
    refuse = lambda *_, **__: pytest.fail("the whole table was read")
    with monkeypatch.context() as patched:
        patched.setattr("inertiax.exports.compensated_stream.compensate_file", refuse)
        done = write_compensated(
            calibration(), tmp_path / source, tmp_path / target, rows=64, size=SIZE
        )
    assert (done.rows, done.num_extrapolated) == (ROWS, whole.num_extrapolated)
    assert done.notes == whole.notes
    assert "at 15.00…35.00 °C are outside the calibrated 10.00…30.00 °C" in done.notes[0]
    if target.endswith("csv"):
        whole = compensate_file(calibration(), tmp_path / source, as_text=True)
        whole.table.write_csv(tmp_path / "whole.csv")
        assert (tmp_path / target).read_bytes() == (tmp_path / "whole.csv").read_bytes()
    else:
        assert_frame_equal(pl.read_parquet(tmp_path / target), whole.table, check_exact=True)


@pytest.mark.parametrize("start_row", [0, 64, 100])
def test_the_campaign_says_names_units_and_the_first_row(tmp_path, start_row):
    table = log().rename({"time": "t", "temperature": "probe"}).with_columns(pl.col("t") * 1e3)
    table.write_parquet(tmp_path / "a.parquet")
    (tmp_path / "campaign.toml").write_text(
        f'[recordings]\nfiles = ["a.parquet"]\nstart_row = {start_row}\n[columns]\ntemperature = "probe"\n'
        'time = { name = "t", unit = "ms" }\naccel = { unit = "g" }\n'
    )
    whole = compensate_file(calibration(), tmp_path / "a.parquet", campaign=tmp_path)
    target = tmp_path / "out.parquet"
    write_compensated(calibration(), tmp_path / "a.parquet", target, campaign=tmp_path, rows=64)
    assert_frame_equal(pl.read_parquet(target), whole.table, check_exact=True)
    assert whole.table.height == ROWS - start_row


@pytest.mark.parametrize("effects", [(), (FittedEffect(
    "g_sensitivity", "gyro", (1,), (("axes", "x"),), np.array([1e-3]), np.array([[1e-8]]), "rad/s/g"),
)])  # fmt: skip
@pytest.mark.parametrize("has_angles", [True, False])
def test_the_campaign_of_a_table_reads_logs_with_and_without_its_angles(
    tmp_path, effects, has_angles
):
    """What the station writes is not asked of a log from the device in service, and changes no sample."""
    angles = {"outer": np.zeros(ROWS), "inner": np.zeros(ROWS)} if has_angles else {}
    log().with_columns(**angles).write_csv(tmp_path / "log.csv")
    log().write_csv(tmp_path / "plain.csv")
    (tmp_path / "campaign.toml").write_text(
        f"[site]\ngravity = {GRAVITY}\nlatitude = 48.0\n[recordings]\nfiles = ['log.csv']\n"
        "[columns]\ntable_angles = { names = ['outer', 'inner'] }\n"
        "position = { name = 'step', moving = 0 }\n[table]\naxes = ['east', 'up']\n"
    )
    made = compensate_file(calibration(*effects), tmp_path / "log.csv", campaign=tmp_path)
    expected = compensate_file(calibration(*effects), tmp_path / "plain.csv")
    assert_frame_equal(made.table.drop(*angles), expected.table)
    written = write_compensated(
        calibration(*effects), tmp_path / "log.csv", tmp_path / "out.parquet", campaign=tmp_path
    )
    assert written.rows == ROWS


def test_rests_tell_before_and_after(tmp_path):
    """By hand: |f + b| − g and |b| of six rests of 25 s, moved between; nothing of a log that moves all along."""
    rng = np.random.default_rng(8)
    still = np.repeat(np.arange(6), 250)
    moving = np.tile(np.arange(250) >= 200, 6)
    up = np.concatenate([np.eye(3), -np.eye(3)])[still] * GRAVITY
    bias, turn = np.array([0.2, -0.1, 0.15]), np.array([0.01, 0.02, -0.01])
    shaken = np.where(moving[:, None], 3.0, 1e-3) * rng.standard_normal((1500, 3))
    columns = {"time": 0.1 * np.arange(1500), "temperature": np.full(1500, 20.0)}
    columns |= {f"accel_{a}": (up + bias + shaken)[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": (turn + 0.1 * shaken)[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    triads = [
        TriadCalibration(Curve(Constant(), b[None]), np.zeros((3, 3)), names, "static")
        for b, names in (
            (bias, tuple(f"accel.bias[{k}]" for k in range(3))),
            (turn, tuple(f"gyro.bias[{k}]" for k in range(3))),
        )
    ]
    known = Calibration(gravity=GRAVITY, accel=triads[0], gyro=triads[1])
    written = write_compensated(known, tmp_path / "log.csv", tmp_path / "out.csv", size=SIZE)
    told = compensate_file(known, tmp_path / "log.csv").at_rest
    off = np.linalg.norm(up[::250] + bias, axis=1) - GRAVITY
    for found in (told, written.at_rest):
        assert found.seconds == 6 * 20
        np.testing.assert_allclose(found.force[0], np.sqrt(np.mean(off**2)), rtol=1e-2)
        np.testing.assert_allclose(found.rate[0], np.linalg.norm(turn), rtol=1e-2)
        assert found.force[1] < 1e-3 and found.rate[1] < 1e-4
    np.testing.assert_allclose(told.force, written.at_rest.force, rtol=1e-9)
    columns["gyro_x"] = columns["gyro_x"] + 1.0
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    assert compensate_file(known, tmp_path / "log.csv").at_rest is None


def test_an_effect_with_memory_is_taken_from_the_whole_log(tmp_path):
    lag = FittedEffect(
        "thermal_lag", "accel", (0,), (("time_constant", 2.0),), np.array([0.9]), np.array([[1e-4]]),
        "1", (0.0, 7.0), (10.0, 30.0), 0.3, 1, (10.0, 30.0),
    )  # fmt: skip
    log().write_parquet(tmp_path / "a.parquet")
    whole = compensate_file(calibration(lag), tmp_path / "a.parquet")
    write_compensated(calibration(lag), tmp_path / "a.parquet", tmp_path / "out.parquet", rows=64)
    found = pl.read_parquet(tmp_path / "out.parquet")
    assert_frame_equal(found, whole.table, check_exact=True)
    plain = compensate_file(calibration(), tmp_path / "a.parquet").table
    assert np.abs(found["accel_x"] - plain["accel_x"]).max() > 1e-6  # so the effect is there


def _time_goes_back(table: pl.DataFrame) -> pl.DataFrame:
    return table.with_columns(
        time=pl.when(pl.int_range(pl.len()) >= 128).then(0.1).otherwise("time")
    )


DAMAGES = {
    "time goes back where a piece begins": _time_goes_back,
    "no number": lambda t: t.with_columns(
        gyro_y=pl.when(pl.int_range(pl.len()) == 300).then(None).otherwise("gyro_y")
    ),
    "no column": lambda t: t.drop("accel_z"),
    "two devices": lambda t: t.with_columns(
        device=pl.when(pl.int_range(pl.len()) < 128).then(pl.lit("A")).otherwise(pl.lit("B"))
    ),
    "no temperature": lambda t: t.drop("temperature"),
    "no rows": lambda t: t.head(0),
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("source", ["a.csv", "a.parquet"])
def test_bad_input_is_told_as_for_the_whole_table(tmp_path, source, damage):
    write = pl.DataFrame.write_csv if source.endswith("csv") else pl.DataFrame.write_parquet
    write(DAMAGES[damage](log()), tmp_path / source)
    with pytest.raises(ValueError) as whole:
        compensate_file(calibration(), tmp_path / source)
    with pytest.raises(ValueError) as found:
        write_compensated(
            calibration(), tmp_path / source, tmp_path / "out.csv", rows=64, size=SIZE
        )
    assert str(found.value) == str(whole.value)
    assert [p.name for p in tmp_path.iterdir()] == [source]


@pytest.mark.parametrize(
    "change",
    [
        lambda b: b,
        lambda b: b.replace(b"\n", b"\r\n"),
        lambda b: b"\xef\xbb\xbf" + b,
        lambda b: b"sep=,\n# a logger's own line\n" + b,
        lambda b: b.replace(b"\n1.5,", b"\n\n1.5,"),
        lambda b: b.removesuffix(b"\n"),
    ],
)
def test_a_text_in_pieces_holds_the_fields_of_the_whole(tmp_path, change):
    from inertiax.data.formats import csv

    log().write_csv(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_bytes(change((tmp_path / "a.csv").read_bytes()))
    pieces = list(text_batches.batches(tmp_path / "a.csv", None, header_line=None, size=SIZE))
    assert len(pieces) > 5
    assert_frame_equal(pl.concat(pieces), csv.read_table(tmp_path / "a.csv"))


@pytest.mark.parametrize(
    "change",
    [
        lambda b: b"\0\0" + b,
        lambda b: b.replace(b"\n", b"\r"),
        lambda b: b.replace(b"r9, said", b"r9\nsaid"),
    ],
)
def test_a_text_that_cannot_be_cut_is_left_to_who_reads_it_whole(tmp_path, change):
    log().write_csv(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_bytes(change((tmp_path / "a.csv").read_bytes()))
    whole = compensate_file(calibration(), tmp_path / "a.csv")
    write_compensated(calibration(), tmp_path / "a.csv", tmp_path / "b.parquet", size=150)
    assert_frame_equal(pl.read_parquet(tmp_path / "b.parquet"), whole.table, check_exact=True)


def test_parquet_in_pieces_with_text_as_dictionary_and_as_differences(tmp_path):
    import pyarrow.parquet as pq

    table = log()
    differences = {"use_dictionary": False, "column_encoding": {"remark": "DELTA_BYTE_ARRAY"}}
    for name, how in (("plain", {}), ("delta", differences)):
        arrow = table.select("time", "remark").to_arrow()
        pq.write_table(arrow, tmp_path / f"{name}.parquet", **how)
        pieces = list(parquet.batches(tmp_path / f"{name}.parquet", 64))
        assert {p.height for p in pieces[:-1]} == {64}
        assert_frame_equal(pl.concat(pieces), parquet.decode(tmp_path / f"{name}.parquet"))


def test_kinds_of_columns_widen_from_piece_to_piece():
    column = ["1", None, " 2 ", "2.5", "x"]
    kinds, seen = None, []
    for text in ([None], *([c] for c in column)):
        kinds = kinds_of(pl.DataFrame({"a": text}, schema={"a": pl.String}), kinds)
        seen.append(KINDS[kinds["a"]])
    assert seen == [None, pl.Int64, pl.Int64, pl.Int64, pl.Float64, pl.String]
    whole = pl.DataFrame({"a": column[:4]})
    assert typed(whole, kinds_of(whole))["a"].to_list() == [1.0, None, 2.0, 2.5]


def test_numbers_of_a_text_are_numbers_only_where_they_give_it_back():
    """Whole numbers of one piece that floats of another cannot hold stay text, as in the whole table."""
    columns = {
        "whole": ["7", " 12", "-3"],
        "mixed": ["7", "2.5", "1e-05"],
        "gaps": ["nan", None, "1.25"],
        "lot": ["0098", "0099", "0100"],
        "version": ["1.9", "1.10", "1.11"],
        "pressure": ["99130.00", "99131.50", "99129.25"],
        "serial": ["1e5", "2e5", "3e5"],
        "large": ["18446744073709551615", "1", "2"],
        "late": ["9007199254740993", "1.5", "2.5"],
        "time": ["0.10", "0.20", "0.30"],
        "device": ["12", "12", "12"],
    }
    table = pl.DataFrame(columns, schema=dict.fromkeys(columns, pl.String))
    for pieces in ([table], [table[:1], table[1:2], table[2:]]):
        kinds = TextKinds("device", ["time"], as_text=False)
        for piece in pieces:
            kinds.see(piece)
        kept = kinds.kept(table)
        numbers = {n: kept[n].dtype for n in kept.columns if kept[n].dtype != pl.String}
        assert numbers == {
            "whole": pl.Int64, "mixed": pl.Float64, "gaps": pl.Float64, "time": pl.Float64,
            "pressure": pl.Float64,
        }  # fmt: skip
        assert kinds.read(table)["lot"].to_list() == [98, 99, 100]
        assert kinds.read(table)["device"].to_list() == ["12"] * 3


@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "in pieces"])
def test_columns_of_a_text_are_kept_as_they_are(tmp_path, pieces):
    kept = {
        "lot": [f"{k:04d}" for k in range(ROWS)], "version": ["1.9", "1.10"] * (ROWS // 2), "blanks": [" 5"] * ROWS,
        "big": ["18446744073709551615"] * ROWS,
    }  # fmt: skip
    table = (
        log()
        .rename({"time": "t"})
        .with_columns(pl.col("t").round(2), *(pl.Series(n, v) for n, v in kept.items()))
    )
    table.write_csv(tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "campaign.toml").write_text(
        '[recordings]\nfiles = ["log.csv"]\n[columns]\ntime = "t"\n'
    )
    out = {s: tmp_path / f"out.{s}" for s in ("csv", "parquet")}
    size = SIZE if pieces else len(text) + 1
    for target in out.values():
        write_compensated(calibration(), tmp_path / "log.csv", target, campaign=tmp_path, size=size)
    raw, made = (pl.read_csv(p, infer_schema=False) for p in (tmp_path / "log.csv", out["csv"]))
    names = [n for n in raw.columns if n[:5] not in ("accel", "gyro_")]
    assert_frame_equal(made.select(names), raw.select(names))
    typed_table = pl.read_parquet(out["parquet"])
    assert {n: typed_table[n].to_list() for n in kept if n != "blanks"} == {
        n: v for n, v in kept.items() if n != "blanks"
    }
    assert typed_table.schema["blanks"] == typed_table.schema["count"] == pl.Int64


@pytest.mark.parametrize("target", ["out.csv", "out.parquet"])
@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "in pieces"])
@pytest.mark.parametrize(
    ("written", "serial"), [("0012", "0012"), (" 5581", "5581"), ("12 ", "12"), ("1e5", "1e5")]
)
def test_the_device_is_its_text_without_blanks(tmp_path, written, serial, pieces, target):
    log().with_columns(sn=pl.lit(written)).write_csv(tmp_path / "log.csv")
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n[columns]\ndevice = "sn"\n'
    )
    (read,) = load_campaign(tmp_path).recordings
    assert read.device == serial
    known = replace(calibration(), device=serial)
    size = SIZE if pieces else 1 << 20
    file = tmp_path / target
    write_compensated(known, tmp_path / "log.csv", file, campaign=tmp_path, size=size)
    other = replace(calibration(), device=f"{serial}1")
    with pytest.raises(ValueError, match=f"recorded by device '{serial}'"):
        write_compensated(other, tmp_path / "log.csv", file, campaign=tmp_path, size=size)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["a.csv", "a.parquet"])
@pytest.mark.parametrize("start_row", [0, 30])
@pytest.mark.parametrize("blocks", [True, False], ids=["blocks", "interleaved"])
def test_of_several_devices_the_calibrations_own_rows_are_taken(
    tmp_path, source, start_row, blocks
):
    both = [log().with_columns(device=pl.lit(d), count=pl.Series(k)) for d, k in (
        ("A7", np.arange(ROWS)), ("B", np.arange(ROWS) + 1000),
    )]  # fmt: skip
    table = pl.concat(both)
    if not blocks:
        table = table.sort("time", maintain_order=True)
    write = pl.DataFrame.write_csv if source.endswith("csv") else pl.DataFrame.write_parquet
    write(table, tmp_path / source)
    (tmp_path / "campaign.toml").write_text(
        f'[recordings]\nfiles = ["{source}"]\nstart_row = {start_row}\n'
    )
    for device in ("A7", "B"):
        mine = table[start_row:].filter(pl.col("device") == device)
        write(mine, tmp_path / f"alone-{source}")
        known = replace(calibration(), device=device)
        out = tmp_path / "out.parquet"
        done = write_compensated(
            known, tmp_path / source, out, campaign=tmp_path, rows=64, size=SIZE
        )
        expected = compensate_file(known, tmp_path / f"alone-{source}").table
        assert_frame_equal(pl.read_parquet(out), expected, check_exact=True)
        said = f"{mine.height} of {2 * ROWS - start_row} rows are compensated, those of device {device}, one of 2"
        assert said in done.notes[0]
    with pytest.raises(ValueError, match=r"holds 2 devices \(A7, B\)"):
        compensate_file(replace(calibration(), device="C"), tmp_path / source)
    with pytest.raises(ValueError, match="holds 2 devices"):
        compensate_file(calibration(), tmp_path / source)
    row = mine.height - 1
    late = pl.when(pl.col("count") == 1000 + ROWS - 1).then(-1.0).otherwise("time").alias("time")
    write(table.with_columns(late), tmp_path / source)
    with pytest.raises(ValueError, match=rf"rows of one device \(device B\): time .* row {row} "):
        write_compensated(known, tmp_path / source, out, campaign=tmp_path, rows=64, size=SIZE)


def test_a_device_of_blanks_is_none(tmp_path):
    sn = pl.when(pl.int_range(pl.len()) == 3).then(pl.lit("  ")).otherwise(pl.lit("A7"))
    log().with_columns(device=sn).write_csv(tmp_path / "log.csv")
    with pytest.raises(ValueError, match="column 'device' is empty in row 3"):
        compensate_file(calibration(), tmp_path / "log.csv")


def test_rows_by_numpy_are_what_the_calibration_makes_of_each_sample():
    own, rng = calibration(), np.random.default_rng(7)
    names = tuple(f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3))
    constant = Curve(Constant(), 0.01 * rng.standard_normal((1, 9)))
    by_force = TriadCalibration(constant, np.zeros((9, 9)), names, "reference")
    samples = rng.standard_normal((20, 3)), rng.standard_normal((20, 3)), np.linspace(5.0, 40.0, 20)
    for device in (own, replace(own, gyro=by_force), Calibration(GRAVITY, accel=own.accel)):
        expected = jax.vmap(device)(*samples)
        for made, sample in zip(compensated_rows(device, *samples), expected, strict=True):
            np.testing.assert_allclose(made, sample, rtol=0.0, atol=1e-14)  # of order 1
