"""A table's campaign whose device has a dead channel or exchanged axes: said once, with the right cure."""

import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.plausibility import check_campaign, Finding


G, RATE, REST, MOVE = 9.81, 100.0, 200, 100
AXES = [*np.eye(3), *-np.eye(3)]


def table(seed: int = 0) -> dict[str, np.ndarray]:
    """Rests in random attitudes, turned by SciPy's rotations between them, then turns at ±1 rad/s about each axis."""
    rng = np.random.default_rng(seed)
    attitude, up, omega, label = Rotation.random(random_state=seed), [], [], []

    def turn(rotation: np.ndarray, rows: int, speed: np.ndarray, number: int) -> None:
        nonlocal attitude
        path = attitude * Rotation.from_rotvec(np.cumsum(speed)[:, None] / RATE * rotation)
        up.append(path.inv().apply([0, 0, 1.0]))
        omega.append(speed[:, None] * rotation)
        label.append(np.full(rows, number))
        attitude = path[-1]

    for number in range(16):
        turn(np.zeros(3), REST, np.zeros(REST), number)
        axis = rng.standard_normal(3)
        done = np.arange(MOVE) / MOVE
        speed = rng.uniform(0.8, 2.0) * (1 - np.cos(2 * np.pi * done)) * RATE / MOVE
        turn(axis / np.linalg.norm(axis), MOVE, speed, -1)
    for axis in AXES:
        turn(axis, 300, np.ones(300), -1)
    force, rate = G * np.concatenate(up), np.concatenate(omega)
    n = len(force)
    return {
        "time": np.arange(n) / RATE,
        "accel": force + [0.05, -0.03, 0.02] + 0.01 * rng.standard_normal((n, 3)),
        "gyro": rate + [0.004, -0.003, 0.002] + 0.001 * rng.standard_normal((n, 3)),
        "position": np.concatenate(label),
        "reference_accel": force,
        "reference_gyro": rate,
    }


def findings(columns: dict[str, np.ndarray], model: ModelChoice | None = None) -> list[Finding]:
    recording = Recording(**columns, name="a.csv")
    campaign = Campaign((recording,), Site(gravity=G), model=model or ModelChoice())
    return [f for f in check_campaign(campaign).findings if f.severity != "note"]


def test_a_sound_table_is_plausible():
    assert findings(table()) == []


@pytest.mark.parametrize("triad", ["accel", "gyro"])
def test_a_dead_channel_is_all_that_is_said(triad):
    columns = table()
    columns[triad][:, 1] = 0.0
    (found,) = findings(columns)
    assert (found.kind, found.severity, found.what) == ("constant_channel", "error", f"{triad}_y")
    assert "never changes (0)" in found.statement


@pytest.mark.parametrize("triad", ["accel", "gyro"])
def test_a_channel_held_from_some_moment_on_is_said_with_the_moment(triad):
    columns = table()
    rows = len(columns["time"]) // 2
    columns[triad][rows:, 2] = columns[triad][rows, 2]
    (found,) = findings(columns)
    assert (found.kind, found.severity, found.what) == ("constant_channel", "error", f"{triad}_z")
    assert f"for {len(columns['time']) - rows} rows from {rows / RATE:g} s" in found.statement


def test_a_channel_at_rest_in_coarse_steps_is_not_called_dead_with_certainty():
    rng = np.random.default_rng(3)
    n = 20_000
    coarse = np.round(([0.2, 0.0, 9.8] + 0.02 * rng.standard_normal((n, 3))) / 0.1) * 0.1
    coarse[:, 1] = 0.0
    found = findings({"time": np.arange(n) / RATE, "accel": coarse})
    assert [f.severity for f in found if f.kind == "constant_channel"] == ["warning"]


def test_a_dead_channel_of_a_triad_that_is_left_alone_is_a_warning():
    columns = table()
    columns["gyro"][:, 1] = 0.0
    found = findings(columns, ModelChoice(gyro_estimator="none"))
    assert [f.severity for f in found] == ["warning"]


def test_axes_exchanged_in_both_triads_are_one_finding_with_both_lines():
    columns = table()
    for triad in ("accel", "gyro"):
        columns[triad] = columns[triad][:, [1, 0, 2]]
    (found,) = findings(columns)
    assert (found.kind, found.severity) == ("axes", "error")
    assert "in both x and y are exchanged" in found.statement
    assert found.remedy is not None
    said = tomllib.loads(found.remedy)["columns"]
    assert said["accel"]["names"] == ["accel_y", "accel_x", "accel_z"]
    assert said["gyro"]["names"] == ["gyro_y", "gyro_x", "gyro_z"]


def test_axes_exchanged_in_one_triad_are_said_of_it_alone():
    columns = table()
    columns["gyro"] = columns["gyro"][:, [0, 2, 1]]
    (found,) = findings(columns)
    assert (found.kind, found.what) == ("axes", "gyro")
    assert "y and z are exchanged" in found.statement


def test_without_references_mirrored_gyros_may_be_exchanged_axes_of_both():
    columns = {k: v for k, v in table().items() if not k.startswith("reference")}
    for triad in ("accel", "gyro"):
        columns[triad] = columns[triad][:, [1, 0, 2]]
    (found,) = [f for f in findings(columns) if f.kind == "axes"]
    assert "two axes of both triads are exchanged" in found.statement
