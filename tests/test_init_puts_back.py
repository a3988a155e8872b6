"""`init` keeps a draft that lines can mend, and leaves nothing of one that none can."""

import numpy as np
import pytest
from typer.testing import CliRunner

from inertiax.cli.app import app


def init(*arguments):
    return CliRunner().invoke(app, ["init", *map(str, arguments)])


@pytest.fixture
def foreign(tmp_path):
    """A file whose suffix is a flight log's, and whose content is not."""
    path = tmp_path / "ankle.bin"
    path.write_bytes(bytes(range(1, 200)) * 20)
    return path


def test_of_a_file_that_no_line_mends_nothing_is_left(foreign, tmp_path):
    done = init(foreign, "-o", tmp_path / "new" / "deeper")
    assert done.exit_code == 1
    assert not (tmp_path / "new").exists()
    assert [p.name for p in tmp_path.iterdir()] == [foreign.name]


def test_a_campaign_that_was_there_stays(foreign, tmp_path):
    kept = tmp_path / "campaign.toml"
    kept.write_text("# by hand\n")
    assert init(foreign, "--replace").exit_code == 1
    assert kept.read_text() == "# by hand\n"


def test_a_draft_that_lines_can_mend_is_kept_and_called_one(tmp_path):
    """Rows without numbers in the accelerometers, which are for the user to drop or to map otherwise."""
    rng = np.random.default_rng(0)
    rows = 0.01 * rng.standard_normal((400, 7)) + [0.0, 0.1, 0.2, 9.8, 0.0, 0.0, 0.0]
    rows[:, 0] = np.arange(400) / 100.0
    rows[7, 2] = np.nan
    log = tmp_path / "log.csv"
    names = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
    np.savetxt(log, rows, delimiter=",", header=names, comments="")
    done = init(log)
    assert done.exit_code == 0 and (tmp_path / "campaign.toml").is_file()
    assert "draft to mend" in done.output and "no finite number" in done.output
