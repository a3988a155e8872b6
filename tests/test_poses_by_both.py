"""Poses that a hand held: the accelerometers are quiet in them, the gyros are not, and all words count alike."""

import numpy as np

from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.model_selection.poses import directions, directions_without_gyros
from inertiax.model_selection.select_model import choose_model, settle_accel
from inertiax.reduction.dwell_means import reduce_to_dwells


G = 9.81
RATE = 100.0
UP = np.array([[0, 0, 1], [1, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 0, 1]], float)


def log(pause=4.0, tremor=4.0):
    """Upright on a table for 10 s, and between on three faces for a `pause`, s, by hand: it trembles by 3°/s rms about
    the axis up (`tremor`, °/s)."""
    rng = np.random.default_rng(7)
    force, rate = [], []
    for k, up in enumerate(UP):
        rows = int(RATE * (pause if k % 2 else 10.0))
        time = np.arange(rows) / RATE
        force.append(np.tile(G * up, (rows, 1)))
        trembling = np.radians(tremor) * np.sin(2 * np.pi * 1.7 * time + k)
        rate.append(np.outer(trembling, up) * (k % 2))
        if k < len(UP) - 1:
            turn = np.linspace(0.0, np.pi / 2, 100)[:, None]
            force.append(G * (np.cos(turn) * up + np.sin(turn) * UP[k + 1]))
            rate.append(np.tile(np.pi / 2 * np.cross(UP[k + 1], up), (100, 1)))
    force, rate = np.concatenate(force), np.concatenate(rate)
    force += 0.02 * rng.normal(size=force.shape)
    rate += 0.001 * rng.normal(size=rate.shape)
    return Recording(time=np.arange(len(force)) / RATE, accel=force, gyro=rate, name="a.csv")


def test_the_model_says_why_poses_do_not_count():
    recording = log()
    campaign = Campaign((recording,), Site(gravity=G))
    dwells = reduce_to_dwells([recording])
    assert directions(dwells, [recording]) == 1
    assert directions_without_gyros([recording]) == 4
    chosen, warning = settle_accel(campaign, choose_model(campaign, campaign.recordings), dwells)
    reason = next(r for r in chosen.reasons if r.startswith("accelerometers"))
    assert "all rests are in one pose" in reason and warning is None
    assert "quiet in 4 directions, but the gyros turn there" in reason


def test_the_model_says_which_poses_were_too_brief():
    recording = log(pause=1.2, tremor=0.0)
    campaign = Campaign((recording,), Site(gravity=G))
    dwells = reduce_to_dwells([recording])
    assert directions(dwells, [recording]) == 1
    chosen, _ = settle_accel(campaign, choose_model(campaign, campaign.recordings), dwells)
    reason = next(r for r in chosen.reasons if r.startswith("accelerometers"))
    assert "for half a second at a time it is quiet in 4 directions, too short to count" in reason


def test_a_draft_counts_the_poses_of_a_calibration(tmp_path):
    recording = log()
    table = np.column_stack([recording.time, recording.accel, recording.gyro])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header="time,ax,ay,az,gx,gy,gz", comments="", fmt="%.6f")
    text = draft_campaign(path, tmp_path).text
    assert "# 1 pose in 4 rests; the accelerometers alone are quiet 7 times, in 4, but" in text
    assert "# 4 poses" not in text
