"""What `compensate` wrote is told from a recording: it is not fitted with the others and not compensated again."""

import polars as pl
import pytest

from bad_inputs_cases import CSV, good_calibration, TABLE, TOML
from inertiax.cli import main
from inertiax.data.campaign import load_campaign
from inertiax.data.compensated import is_compensated, reads_compensated


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
