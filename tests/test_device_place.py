"""Lever arms of a table and those of a device: a rigid body whose places are differentiated numerically."""

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

from command_runs import run
from inertiax.calibration.calibration import (
    Calibration,
    read_calibration,
    TriadCalibration,
    write_calibration,
)
from inertiax.calibration.device_place import about_device, place_on_table
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.exports.compensated_stream import write_compensated
from inertiax.physics.temperature import Constant, Curve


G = 9.81
RATE = 500.0  # Hz
# From the table's axes, m: a device at (30, -20, 50) mm whose accelerometers are apart by up to 12 mm.
ARMS = np.array([[0.030, -0.008, 0.055], [0.024, -0.020, 0.050], [0.030, -0.020, 0.052]])
PLACE = np.diagonal(ARMS)


def known(arms=ARMS, sigma=1e-4):
    effect = lambda k: FittedEffect(
        "size_effect", "accel", (k,), (), arms[k], sigma**2 * np.eye(3), "m"
    )
    names = [f"bias[{k}]" for k in range(3)] + [
        f"matrix[{i},{j}]" for i in range(3) for j in range(3)
    ]
    triads = [
        TriadCalibration(
            Curve(Constant(), np.zeros((1, 12))), np.zeros((12, 12)),
            tuple(f"{t}.{n}" for n in names), "reference",
        )
        for t in ("accel", "gyro")
    ]  # fmt: skip
    return Calibration(G, *triads, effects=tuple(effect(k) for k in range(3)))


def moved(arms=ARMS):
    """Outputs of a device that is carried about, and the force at its own place and at the table's axes."""
    time = np.arange(0.0, 6.0, 1.0 / RATE)
    knots = np.linspace(0.0, 6.0, 13)
    rng = np.random.default_rng(5)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.6, (13, 3)), axis=0))
    spline = RotationSpline(knots, turns)
    attitude, rate = spline(time), spline(time, 1)
    path = 0.2 * np.stack([np.sin(k * time) for k in (0.7, 1.1, 1.6)], axis=1)  # of its own place

    def force(place):
        places = path + attitude.apply(place)
        felt = np.gradient(np.gradient(places, time, axis=0), time, axis=0) + [0.0, 0.0, G]
        return attitude.inv().apply(felt)

    accel = np.stack([force(arms[k] - PLACE)[:, k] for k in range(3)], axis=1)
    columns = {"time": time} | {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": rate[:, k] for k, a in enumerate("xyz")}
    return pl.DataFrame(columns), force(np.zeros(3)), force(-PLACE)


@pytest.mark.parametrize("at_table", [False, True])
def test_the_force_is_that_at_the_device_s_own_place(tmp_path, at_table):
    table, own, axes = moved()
    table.write_parquet(tmp_path / "log.parquet")
    done = write_compensated(
        known(), tmp_path / "log.parquet", tmp_path / "out.parquet", at_table=at_table
    )
    made = pl.read_parquet(tmp_path / "out.parquet").select("accel_x", "accel_y", "accel_z")
    off = np.abs(made.to_numpy() - (axes if at_table else own))[10:-10].max()
    # Knots of the attitude's spline have jumps in its third derivative; the arms' own part is 1 m/s² here.
    assert off < 0.02 < np.abs(own - axes)[10:-10].max() / 20.0
    # One place is said, the right one.
    (said,) = [note for note in done.notes if "the force is" in note or "force is that" in note]
    assert ("at 30.0, -20.0, 52.0 mm" in said) != at_table
    assert ("is that at the table's axes" in said) == at_table and "no plateau" not in said


def test_the_force_at_the_table_s_axes_says_which_arms_it_lacks(tmp_path):
    """Turns about the axes alone show three of nine; the others are held at zero, here ± 7 mm."""
    moved()[0].write_parquet(tmp_path / "log.parquet")
    log, out = (tmp_path / f"{n}.parquet" for n in ("log", "out"))
    done = write_compensated(known(np.diag(PLACE), 7e-3), log, out, at_table=True)
    assert done.notes[-1].endswith(
        "arms that no plateau showed, taken for 0 ± 7 mm: "
        "x along y, x along z, y along x, y along z, z along x, z along y"
    )


def test_where_the_device_was_mounted_is_none_of_its_properties():
    there = about_device(known(ARMS + [0.2, -0.1, 0.3])).effects
    for one, other in zip(about_device(known()).effects, there, strict=True):
        np.testing.assert_allclose(one.coefficients, other.coefficients, atol=1e-12)
    np.testing.assert_allclose(place_on_table(known()), PLACE)
    assert about_device(known(np.tile(PLACE, (3, 1)))).effects == ()


def test_arms_that_a_plan_does_not_show_are_no_distances(tmp_path, capsys, monkeypatch):
    """Turns about the axes alone show each arm along its own axis; and 6 mm ± 5 mm are no distance."""
    unseen = known(np.diag(PLACE), 1e-5)
    assert about_device(unseen).effects == () and about_device(known(sigma=5e-3)).effects == ()
    write_calibration(unseen, tmp_path / "calibration.json")
    assert len(read_calibration(tmp_path / "calibration.json").effects) == 3
    moved(np.tile(PLACE, (3, 1)))[0].write_csv(tmp_path / "log.csv")
    arguments = ["compensate", tmp_path / "calibration.json", tmp_path / "log.csv"]
    status, _, err = run(capsys, monkeypatch, *arguments, "-o", tmp_path / "out.csv")
    assert status == 0 and "the device's own place" in err
    raw, out = (pl.read_csv(tmp_path / f"{n}.csv") for n in ("log", "out"))
    np.testing.assert_allclose(out["accel_y"], raw["accel_y"], rtol=1e-12)
