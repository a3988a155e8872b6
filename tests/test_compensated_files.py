"""What `compensate` wrote is told from a recording: it is not fitted with the others and not compensated again."""

import numpy as np
import polars as pl
import pytest

from bad_inputs_cases import CSV, good_calibration, TABLE, TOML
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.cli import main
from inertiax.data.campaign import load_campaign
from inertiax.data.compensated import is_compensated, reads_compensated
from inertiax.data.formats import ColumnMap, Layout
from inertiax.data.formats.detect import read_recordings
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.compensated_stream import write_compensated
from inertiax.exports.extrapolation import extrapolated
from inertiax.physics.temperature import Constant, Curve, Polynomial


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """A folder in which a compensated file of each format lies beside its recording."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    (tmp_path / "campaign.toml").write_text(TOML.replace("a.*", "*"))
    (tmp_path / "a.csv").write_text(CSV)
    (tmp_path / ".c.json").write_bytes(good_calibration(thermal=False))
    for name in ("b.csv", "b.parquet"):
        run("compensate", tmp_path / ".c.json", tmp_path / "a.csv", "-o", tmp_path / name, "-q")
    return tmp_path


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as exit:
        main([*map(str, arguments)])
    return int(exit.value.code or 0)


def test_a_glob_skips_what_compensate_wrote_and_says_so(campaign):
    assert [is_compensated(campaign / n) for n in ("a.csv", "b.csv", "b.parquet")] == [
        False,
        True,
        True,
    ]
    loaded = load_campaign(campaign)
    assert [r.name for r in loaded.recordings] == ["a.csv"]
    said = "b.csv, b.parquet: skipped, for `inertiax compensate` wrote them: not a recording"
    assert said in loaded.notes


def test_a_file_that_is_named_in_full_is_read_and_told(campaign):
    (campaign / "campaign.toml").write_text(TOML.replace("a.*", "b.csv"))
    loaded = load_campaign(campaign)
    assert [r.name for r in loaded.recordings] == ["b.csv"]
    assert any(
        "`inertiax compensate` wrote it: what is found are errors that were left" in n
        for n in loaded.notes
    )


def test_a_glob_of_compensated_files_alone_is_refused(campaign):
    (campaign / "campaign.toml").write_text(TOML.replace("a.*", "b.c*"))
    with pytest.raises(
        ValueError, match=r"'b\.c\*' matches only what `inertiax compensate` wrote \(b.csv\)"
    ):
        load_campaign(campaign)


def test_columns_of_other_names_in_a_compensated_file_are_raw_ones(campaign):
    assert reads_compensated(campaign / "b.csv", ())
    assert reads_compensated(campaign / "b.csv", ("accel_x", "accel_y", "accel_z"))
    assert not reads_compensated(campaign / "b.csv", ("ax", "ay", "az"))
    assert not reads_compensated(campaign / "a.csv", ())


@pytest.mark.parametrize("name", ["b.csv", "b.parquet"])
def test_compensating_twice_is_refused_in_a_line(campaign, capfd, name):
    capfd.readouterr()
    status = run("compensate", campaign / ".c.json", campaign / name, "-o", campaign / "d.csv")
    said = capfd.readouterr().err
    assert status == 1 and said.count("\n") == 1
    assert "was compensated already, for it has a column 'extrapolated'" in said
    assert not (campaign / "d.csv").exists()


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", b"PAR1", b"time,extrapolated_x\n", b"extrapolatedx"]
)
@pytest.mark.parametrize("suffix", ["csv", "parquet", "bin"])
def test_other_files_are_left_to_their_readers(tmp_path, content, suffix):
    file = tmp_path / f"a.{suffix}"
    file.write_bytes(content)
    assert not is_compensated(file)
    assert not is_compensated(tmp_path / f"absent.{suffix}")


def test_quotes_and_line_ends_of_other_systems_hide_nothing(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(b'"time", "extrapolated"\r\n0,true\r\n')
    assert is_compensated(file)
    TABLE.with_columns(extrapolated=pl.lit(False)).write_parquet(tmp_path / "a.pq")
    assert is_compensated(tmp_path / "a.pq")


NAMES = tuple(f"accel.{p}" for p in ("bias[0]", "bias[1]", "bias[2]", "matrix[0,0]", "matrix[2,1]"))
BIAS, MATRIX = np.array([0.1, -0.2, 0.3]), np.eye(3) + np.diag([0.02, 0.0, 0.0])
MATRIX[2, 1] = -0.01
RAW_TOML = """
[site]
gravity = 9.81
[recordings]
files = ["raw.csv"]
[columns]
time = { name = "millis", unit = "ms" }
accel = { names = ["ax", "ay", "az"], unit = "g" }
temperature = { name = "probe", unit = "K" }
"""


def made_calibration(basis=None, span=(20.0, 20.4)):
    values = np.zeros((1 if basis is None else basis.size, 5))
    values[0] = [*BIAS, 0.02, -0.01]
    curve = Curve(basis or Constant(), values)
    accel = TriadCalibration(curve, np.zeros((values.size, values.size)), NAMES, "invariant")
    return Calibration(gravity=9.81, accel=accel, temperature_range=span)


@pytest.fixture
def other_units(tmp_path):
    """A log in ms, g and K, what its own columns hold in SI, and the compensated file beside it."""
    rng = np.random.default_rng(4)
    count = 3000
    force = 0.05 * rng.standard_normal((count, 3)) + [0.0, 0.0, 9.81]
    outputs = force @ MATRIX.T + BIAS
    columns = {"millis": 5000 + 10 * np.arange(count)}
    columns |= {f"a{axis}": outputs[:, k] / 9.80665 for k, axis in enumerate("xyz")}
    columns["probe"] = 273.15 + np.linspace(19.9, 20.5, count)
    pl.DataFrame(columns).write_csv(tmp_path / "raw.csv")
    (tmp_path / "campaign.toml").write_text(RAW_TOML)
    done = write_compensated(
        made_calibration(), tmp_path / "raw.csv", tmp_path / "done.csv", campaign=tmp_path
    )
    return tmp_path, force, done


def test_a_compensated_file_is_read_without_its_campaign(other_units):
    folder, force, done = other_units
    (log,) = read_recordings(folder / "done.csv", ColumnMap(), Layout(), name="csv")
    np.testing.assert_allclose(log.accel, force, rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.time, 5.0 + 0.01 * np.arange(3000), rtol=1e-15)
    np.testing.assert_allclose(log.temperature[:, 0], np.linspace(19.9, 20.5, 3000), atol=1e-12)
    kept = pl.read_csv(folder / "done.csv").select("millis", "ax", "ay", "az", "probe")
    assert kept.equals(pl.read_csv(folder / "raw.csv"))
    assert done.units == {"accel": "m/s^2"}


def test_init_takes_the_compensated_columns(other_units):
    folder, force, _ = other_units
    draft = draft_campaign(folder / "done.csv", folder, latitude=49.0)
    assert "[columns]" not in draft.text and "[model]" not in draft.text
    (folder / "campaign.toml").write_text(draft.text)
    (log,) = load_campaign(folder).recordings
    np.testing.assert_allclose(log.accel, force, rtol=0, atol=1e-12)


def test_a_numeric_time_in_another_unit_is_replaced_and_stamps_in_words_are_not(tmp_path):
    rows = pl.DataFrame({"time": [0, 10, 20], **{f"accel_{a}": [0.0, 0.1, 9.8] for a in "xyz"}})
    rows.write_csv(tmp_path / "raw.csv")
    text = '[recordings]\nfiles = ["raw.csv"]\n[columns]\ntime = { name = "time", unit = "ms" }\n'
    (tmp_path / "campaign.toml").write_text(text)
    made = compensate_file(made_calibration(), tmp_path / "raw.csv", campaign=tmp_path).table
    np.testing.assert_allclose(made["time"], [0.0, 0.01, 0.02])
    stamps = [f"2026-01-31T12:00:0{k}.5" for k in range(3)]
    rows.with_columns(time=pl.Series(stamps)).write_csv(tmp_path / "raw.csv")
    made = compensate_file(made_calibration(), tmp_path / "raw.csv").table
    assert made["time"].to_list() == stamps


def test_counted_rows_go_on_from_piece_to_piece(tmp_path):
    rows = pl.DataFrame({f"accel_{a}": np.linspace(0.0, 9.0, 500) for a in "xyz"})
    rows.write_parquet(tmp_path / "raw.parquet")
    text = '[recordings]\nfiles = ["raw.parquet"]\n[columns]\ntime = { rate = 50 }\n'
    (tmp_path / "campaign.toml").write_text(text)
    write_compensated(
        made_calibration(), tmp_path / "raw.parquet", tmp_path / "done.parquet",
        campaign=tmp_path, rows=64,
    )  # fmt: skip
    found = pl.read_parquet(tmp_path / "done.parquet")["time"]
    np.testing.assert_array_equal(found, np.arange(500) / 50.0)


@pytest.mark.parametrize(
    ("basis", "span", "inside", "outside"),
    [
        # Constants of 0.4 °C: with 0.6 °C more the range is 1 °C wide, from which on a curve is looked for.
        (None, (20.0, 20.4), (19.41, 20.99), (19.39, 21.01)),
        # 2 % of 50 °C.
        (Polynomial(2, 0.0, 50.0), (0.0, 50.0), (-0.99, 50.99), (-1.01, 51.01)),
        # 2 % of 0.4 °C: a curve over so little is no constant.
        (Polynomial(1, 20.0, 20.4), (20.0, 20.4), (19.993, 20.407), (19.991, 20.409)),
    ],
)
def test_a_sample_is_outside_by_more_than_the_margin(basis, span, inside, outside):
    calibration = made_calibration(basis, span)
    assert not extrapolated(calibration, np.array([*inside, np.mean(span)])).any()
    assert extrapolated(calibration, np.array(outside)).all()


def test_the_log_that_was_calibrated_is_not_outside_of_itself(other_units):
    """The rests' means, 20.0 to 20.4 °C, are a little less than all samples, 19.9 to 20.5 °C."""
    _, _, done = other_units
    assert done.num_extrapolated == 0 and done.notes == ()


@pytest.mark.parametrize("pieces", [False, True])
@pytest.mark.parametrize(
    ("said", "lost"),
    [
        ("time = { rate = 100 }", ["time"]),
        ('time = { name = "ticks", unit = "us" }', ["time"]),
        ('time = { unit = "ms" }\ntemperature = { unit = "K" }', []),
        ('temperature = "probe"', ["temperature"]),
    ],
)
def test_a_time_or_temperature_that_gives_way_to_another_is_told(tmp_path, said, lost, pieces):
    rng = np.random.default_rng(5)
    columns = {"time": 7.0 + 0.01 * np.arange(300) + 1e-3 * rng.random(300)}
    columns |= {f"accel_{a}": rng.standard_normal(300) for a in "xyz"}
    columns |= {"ticks": 1000 * np.arange(300), "temperature": 290.0 + rng.random(300)}
    columns |= {"probe": np.linspace(20.0, 21.0, 300)}
    raw = tmp_path / "raw.csv"
    pl.DataFrame(columns).write_csv(raw)
    (tmp_path / "campaign.toml").write_text(
        f'[recordings]\nfiles = ["raw.csv"]\n[columns]\n{said}\n'
    )
    size = 2000 if pieces else 1 << 20
    done = write_compensated(
        made_calibration(), raw, tmp_path / "done.csv", campaign=tmp_path, size=size
    )
    told = [n for n in done.notes if "its own column " in n]
    assert [n.split("its own column ")[1].split()[0] for n in told] == lost


@pytest.mark.parametrize("pieces", [False, True])
def test_raw_columns_of_the_compensated_names_are_told_where_one_file_then_mixes(tmp_path, pieces):
    rng = np.random.default_rng(5)
    values = 0.01 * rng.standard_normal((300, 3)) + [0.0, 0.0, 9.81]
    same = {"time": 0.01 * np.arange(300)} | {
        f"accel_{a}": values[:, k] for k, a in enumerate("xyz")
    }
    said = '[recordings]\nfiles = ["raw.csv"]\n'

    def notes(columns, text):
        pl.DataFrame(columns).write_csv(tmp_path / "raw.csv")
        (tmp_path / "campaign.toml").write_text(text)
        raw = tmp_path / "raw.csv"
        if pieces:
            return write_compensated(
                made_calibration(), raw, tmp_path / "done.csv", campaign=tmp_path, size=2000
            ).notes
        return compensate_file(made_calibration(), raw, campaign=tmp_path).notes

    assert not [n for n in notes(same, said) if "replaced" in n]  # canonical columns, as ever
    in_g = {k: v / 9.80665 if k != "time" else v for k, v in same.items()}
    unit = '[columns]\naccel = { names = ["accel_x", "accel_y", "accel_z"], unit = "g" }\n'
    (told,) = [n for n in notes(in_g, said + unit) if "replaced" in n]
    assert "accel_x/y/z" in told and "raw.csv" in told
