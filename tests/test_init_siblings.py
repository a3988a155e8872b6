"""`inertiax init` of a log with a gyros' file beside it: taken where stamps show one recording, and said either way."""

import tomllib

import numpy as np
import pytest

from hand_log_data import hand_log, written
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()


def drafted(tmp_path, accel, gyro, **options):
    path = written(tmp_path / "AccTest.txt", accel)
    other = written(tmp_path / "GyroTest.txt", gyro)
    found = draft_campaign(path, tmp_path, gyro=other if options else None)
    (tmp_path / "campaign.toml").write_text(found.text)
    return found, tomllib.loads(found.text)["recordings"]


def test_without_stamps_a_file_beside_it_is_not_taken_unasked(tmp_path):
    """As many rows, which a logger that stops after a thousand has in each of its files."""
    found, recordings = drafted(tmp_path, (ACCEL,), (GYRO,))
    assert "gyro_files" not in recordings
    (said,) = found.unread
    assert said.startswith('Not read: "GyroTest.txt" beside it. ') and "stamps" in said
    assert "--gyro GyroTest.txt" in said
    assert load_campaign(tmp_path).recordings[0].gyro is None


def test_asked_for_it_is_taken(tmp_path):
    found, recordings = drafted(tmp_path, (ACCEL,), (GYRO,), asked=True)
    assert recordings["gyro_files"] == ["GyroTest.txt"] and not found.unread


@pytest.mark.parametrize("kept", [0.5, 0.8])
def test_stamps_of_another_length_are_another_recording(tmp_path, kept):
    """Both begin at 0 s, as a logger's stamps do since it was started."""
    rows = round(kept * len(TIME))
    found, recordings = drafted(tmp_path, (TIME, ACCEL), (TIME[:rows], GYRO[:rows]))
    assert "gyro_files" not in recordings and "not of the same time" in found.unread[0]


def test_what_is_taken_is_said_and_can_be_left_out_as_said(tmp_path):
    late = TIME + 0.5  # an app's second sensor begins later
    found, recordings = drafted(tmp_path, (TIME, ACCEL), (late, GYRO))
    assert recordings["gyro_files"] == ["GyroTest.txt"]
    (said,) = found.unread
    assert said.startswith('The gyros are those of "GyroTest.txt" beside it.')
    lines = found.text.splitlines()
    left = [x for x in lines if not x.startswith(("gyro_files =", "gyro_names =", "gyro ="))]
    assert len(lines) - len(left) == 3
    (tmp_path / "campaign.toml").write_text("\n".join(left) + "\n")
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.gyro is None
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-4)
