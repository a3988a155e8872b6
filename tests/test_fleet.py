"""Fleets: batched solves against SciPy and the one-device fit; runs that are broken off; bad devices."""

import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import polars as pl
import pytest
from scipy.optimize import least_squares

from fleet_data import COLUMNS, GRAVITY, HIGH, LOW, ROWS, SIGMA, simulated_dwells, write_line
from hard_limit import ends_within, run_here
from inertiax.estimators import Invariant, ReferenceAccel
from inertiax.fleet import (
    fit_fleet,
    fleet_calibration,
    pipeline,
    read_parts,
    run_fleet,
    stack_dwells,
)
from inertiax.fleet.reduce.tasks import split
from inertiax.numerics.lane_cholesky import inverse_blocks, invert_lanes, invert_lanes_by_blocks
from inertiax.physics.temperature import Constant, Polynomial
from inertiax.procedure.thermal_iterations import joint_fit


# Devices over temperature: two calls of a full batch's program, which the tests share.
MANY = 20


def _spd(n: int, batch: int) -> np.ndarray:
    a = np.random.default_rng(1).standard_normal((batch, n + 5, n)) * np.logspace(0, 3, n)
    return np.einsum("bri,brj->bij", a, a)


def test_lanes_invert_as_numpy_does():
    matrix = _spd(9, 7)
    found = np.asarray(jax.jit(invert_lanes)(matrix.transpose(1, 2, 0))).transpose(2, 0, 1)
    inverse = np.linalg.inv(matrix)
    # Condition 1e7: times 2⁻⁵² it is 2e-9, taken with room, relative to the largest in scaled units.
    size = np.sqrt(np.einsum("bii,bjj->bij", inverse, inverse))
    assert (np.abs(found - inverse) / size).max() < 1e-8


def test_lanes_tell_columns_that_depend_on_others():
    """Rank 8 of 9, in columns of very different size, where rounding leaves a small positive pivot."""
    a = np.random.default_rng(3).standard_normal((20, 50, 9)) * np.logspace(-4, 4, 9)
    a[:10, :, 8] = a[:10, :, 2] * 0.1 + a[:10, :, 5]
    matrix = np.einsum("bri,brj->ijb", a, a)
    found = np.asarray(jax.jit(invert_lanes)(matrix))
    assert np.isnan(found[:, :, :10]).any(axis=(0, 1)).all()
    assert np.isfinite(found[:, :, 10:]).all()


@pytest.mark.parametrize("n", [9, 27])
def test_lanes_invert_by_blocks_as_numpy_does(n):
    matrix = _spd(n, 5)
    matrix[3] = np.ones((n, n))  # of rank one, which shows in the later blocks
    inverse = jax.jit(invert_lanes_by_blocks, static_argnums=1)
    with jax.enable_x64(True):
        found = np.asarray(inverse(matrix.transpose(1, 2, 0), 9)).transpose(2, 0, 1)
    assert np.isnan(found[3]).all()
    good = [0, 1, 2, 4]
    expected = np.linalg.inv(matrix[good])
    size = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))
    assert (np.abs(found[good] - expected) / size).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(("n", "block"), [(9, 9), (63, 9), (24, 12)])
def test_blocks_invert_as_numpy_does(n, block):
    matrix = _spd(n, 5)
    expected = np.linalg.inv(matrix)
    size = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))
    error = (
        np.abs(np.asarray(jax.jit(inverse_blocks, static_argnums=1)(matrix, block)) - expected)
        / size
    )
    assert error.max() < 1e-9


def test_a_matrix_that_is_not_positive_definite_gives_nan_for_itself_alone():
    matrix = np.stack([np.eye(9), np.ones((9, 9)), 2 * np.eye(9)])
    inverse = np.asarray(jax.jit(inverse_blocks, static_argnums=1)(matrix, 9))
    assert not np.isfinite(inverse[1]).any()
    np.testing.assert_allclose(inverse[[0, 2]], [np.eye(9), np.eye(9) / 2], atol=1e-15)


def test_constant_parameters_are_scipys():
    """Residual and minimiser written anew here; SciPy finds the same parameters and covariance."""
    devices, _ = simulated_dwells(0, 3)
    fit = fit_fleet(Invariant(GRAVITY), Constant(), stack_dwells(devices))
    for k, d in enumerate(devices):
        a, total = np.asarray(d.accel), np.hypot(SIGMA, fit.scatter[k])  # the noise, and scatter

        def residual(p, a=a, total=total):
            m = np.eye(3)
            m[ROWS, COLUMNS] += p[3:]
            return (np.linalg.norm(np.linalg.solve(m, (a - p[:3]).T), axis=0) - GRAVITY) / total

        best = least_squares(
            residual, np.zeros(9), method="lm", x_scale="jac", xtol=1e-15, ftol=1e-15
        )
        covariance = np.linalg.inv(best.jac.T @ best.jac)
        sigma = np.sqrt(np.diag(covariance))
        # SciPy's numerical Jacobian limits its minimum to some 1e-6 sigma.
        np.testing.assert_allclose((fit.parameters[k] - best.x) / sigma, 0.0, atol=1e-4)
        np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance[k])), sigma, rtol=1e-3)


@pytest.mark.slow
def test_batched_fit_over_temperature_is_the_joint_fit():
    devices, _ = simulated_dwells(2, MANY)
    basis = Polynomial(2, LOW, HIGH)
    fit = fit_fleet(Invariant(GRAVITY), basis, stack_dwells(devices))
    solve = eqx.filter_jit(lambda d, s: joint_fit(Invariant(GRAVITY, scatter=s), basis, d))
    for k, d in enumerate(devices[:5]):
        one = solve(jax.tree.map(jnp.asarray, d), jnp.asarray(fit.scatter[k]))
        sigma = np.sqrt(np.diag(np.asarray(one.covariance)))
        error = (fit.parameters[k] - np.asarray(one.curve.coefficients).ravel()) / sigma
        assert np.abs(error).max() < 1e-5  # ten times the tolerance of the batched steps
        # The covariance is that of the last factor, some 1e-4 of the way before the minimum.
        np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance[k])), sigma, rtol=2e-3)


@pytest.mark.slow
def test_linear_estimators_are_the_joint_fit():
    devices, _ = simulated_dwells(2, 3)
    rng = np.random.default_rng(8)
    basis, estimator = Polynomial(2, LOW, HIGH), ReferenceAccel()
    with_reference = [
        eqx.tree_at(
            lambda d: d.reference_accel,
            d,
            np.asarray(d.accel) + rng.normal(0, 1e-3, (d.num_dwells, 3)),
            is_leaf=lambda x: x is None,
        )
        for d in devices
    ]
    fit = fit_fleet(estimator, basis, stack_dwells(with_reference))
    weighted = eqx.tree_at(lambda e: e.scatter, estimator, jnp.asarray(fit.scatter[1]))
    one = eqx.filter_jit(lambda d: joint_fit(weighted, basis, d))(
        jax.tree.map(jnp.asarray, with_reference[1])
    )
    sigma = np.sqrt(np.diag(np.asarray(one.covariance)))
    error = (fit.parameters[1] - np.asarray(one.curve.coefficients).ravel()) / sigma
    assert np.abs(error).max() < 1e-6
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance[1])), sigma, rtol=1e-9)


def test_errors_are_what_the_covariance_says():
    devices, truth = simulated_dwells(0, 400)
    fit = fit_fleet(Invariant(GRAVITY), Constant(), stack_dwells(devices))
    error = fit.parameters - truth.reshape(400, -1)
    square = np.einsum("di,dij,dj->d", error, np.linalg.inv(fit.covariance), error)
    # The noise is white and stated. Mean of 400 χ² of 9 degrees: 9 ± 4.24 / 20, taken to four sigma.
    wider = 1.0 + np.square(fit.scatter / SIGMA)
    assert abs(np.mean(square * wider) - 9.0) < 0.85
    # Scatter that the rows do not exclude is in the intervals. Of 3600 parameters' 95 % are held at most:
    sigma = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))
    assert 0.945 < np.mean(np.abs(error) < 1.959964 * sigma) < 0.98


@pytest.mark.slow
def test_one_bad_device_leaves_the_others_as_they_were():
    devices, _ = simulated_dwells(2, MANY)
    basis = Polynomial(2, LOW, HIGH)
    good = fit_fleet(Invariant(GRAVITY), basis, stack_dwells(devices))
    outputs = np.asarray(devices[2].accel).copy()
    outputs[7] = np.nan
    spoiled = [*devices]
    spoiled[2] = eqx.tree_at(lambda d: d.accel, devices[2], outputs)
    spoiled[4] = devices[4][np.arange(8)]  # eight rests for 27 unknowns
    fit = fit_fleet(Invariant(GRAVITY), basis, stack_dwells(spoiled))
    rest = [k for k in range(MANY) if k not in (2, 4)]
    assert not fit.converged[2]
    assert not np.isfinite(np.diagonal(fit.covariance[4])).all()
    sigma = np.sqrt(np.diagonal(good.covariance, axis1=1, axis2=2))[rest]
    # The shared metric of the first steps is another, so the end point moves within the tolerance.
    assert np.abs((fit.parameters[rest] - good.parameters[rest]) / sigma).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 2])
def test_single_precision_loses_what_is_said(degree):
    devices, _ = simulated_dwells(degree, MANY)
    basis = Polynomial(degree, LOW, HIGH) if degree else Constant()
    whole = fit_fleet(Invariant(GRAVITY), basis, stack_dwells(devices))
    single = fit_fleet(Invariant(GRAVITY), basis, stack_dwells(devices), precision="float32")
    assert single.converged.all()
    units = np.tile([GRAVITY] * 3 + [1.0] * 6, degree + 1)
    loss = np.abs(single.parameters - whole.parameters) / units
    # 2⁻²⁴ = 6e-8 for each of the outputs and of the roundings of a dwell's residual.
    assert 1e-9 < loss.max() < 3e-7
    sigma = [np.sqrt(np.diagonal(f.covariance, axis1=1, axis2=2)) for f in (whole, single)]
    # The scatter is a small difference between χ² and its freedom, whose roundings it magnifies.
    np.testing.assert_allclose(sigma[1], sigma[0], rtol=5e-3)


def test_single_precision_is_refused_to_other_estimators():
    devices, _ = simulated_dwells(0, 1)
    with pytest.raises(ValueError, match="is for the invariant estimator.*got ReferenceAccel"):
        fit_fleet(ReferenceAccel(), Constant(), stack_dwells(devices), precision="float32")


@pytest.mark.slow
def test_every_chunk_of_any_size_is_solved_in_double_precision_whatever_jax_is_set_to():
    """A Dask worker has JAX's defaults, and the chunks of a solve run in threads of their own; none may hang."""
    out = run_here(
        """
import numpy as np
from fleet_data import simulated_dwells
from inertiax.estimators import Invariant
from inertiax.fleet import fit_fleet, stack_dwells
from inertiax.physics.temperature import Constant
devices, _ = simulated_dwells(0, 1500)
fits = {}
for count in (1, 300, 1500):
    fits[count] = fit_fleet(Invariant(9.815), Constant(), stack_dwells(devices[:count]))
    assert fits[count].converged.all()
last = fit_fleet(Invariant(9.815), Constant(), stack_dwells(devices[297:300]))
print(float(np.abs(fits[300].parameters[-3:] - last.parameters).max()))
""",
        seconds=300,
        wide=False,
    )
    assert float(out) < 1e-14


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    folder = tmp_path_factory.mktemp("line")
    return folder, write_line(folder, 14)


@pytest.fixture(scope="module")
def whole(line, tmp_path_factory):
    """An undisturbed run, and what it says of itself."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return out, run_fleet(line[0], out)


def by_devices(folder: Path, out: Path, **how: Any) -> None:
    """A run with a task for each device."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "split", lambda files, columns: split(files, columns, rows=1))
        run_fleet(folder, out, **how)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A line whose program, which every process compiles anew, is a small one."""
    folder = tmp_path_factory.mktemp("small")
    return folder, write_line(folder, 10, experiments=1, degree=0)


@pytest.fixture(scope="module")
def by_device(small, tmp_path_factory):
    """The table of a run with a task for each device."""
    out = tmp_path_factory.mktemp("by-device") / "out"
    by_devices(small[0], out, workers=1)
    return read_parts(out).collect().sort("device")


@pytest.mark.slow
def test_raw_rows_to_calibrations_within_their_uncertainty(line, whole):
    _, truth = line
    out, summary = whole
    assert (summary.devices, summary.calibrated) == (14, 14)
    squares = []
    for name, coefficients in truth.items():
        found = fleet_calibration(out, name).accel
        assert found is not None
        low, high = found.curve.basis.low, found.curve.basis.high
        # The true curves in the fitted basis: a straight line has one form in both.
        at = lambda t, c=coefficients: c[0] + c[1] * (2 * t - LOW - HIGH) / (HIGH - LOW)
        expected = np.stack([(at(low) + at(high)) / 2, (at(high) - at(low)) / 2])
        error = (np.asarray(found.curve.coefficients) - expected).ravel()
        squares.append(error @ np.linalg.solve(np.asarray(found.covariance), error))
    # Mean of 14 χ² of 18 degrees: 18 ± 1.6, taken to four sigma.
    assert abs(np.mean(squares) - 18.0) < 6.4


@pytest.mark.slow
def test_bad_devices_are_set_aside_with_the_reason(line, tmp_path):
    folder, _ = line
    table = pl.read_parquet(sorted(folder.glob("*.parquet")))
    x, y = pl.col("accel_x"), pl.col("accel_y")
    serial = pl.col("device")
    spoiled = table.with_columns(
        accel_x=pl.when((serial == "SN0001") & (pl.col("time") > 3.0) & (pl.col("time") < 3.05))
        .then(float("nan"))
        .otherwise(x),
        accel_y=pl.when(serial == "SN0002").then(y.clip(upper_bound=8.0)).otherwise(y),
        accel_z=pl.when(serial == "SN0003")
        .then(pl.col("accel_z") / 9.81)
        .otherwise(pl.col("accel_z")),
    ).filter((serial != "SN0004") | (pl.col("position") < 4))
    spoiled = spoiled.sort("device", "time", maintain_order=True)
    other = tmp_path / "line"
    other.mkdir()
    spoiled.write_parquet(other / "line.parquet")
    (other / "campaign.toml").write_text((folder / "campaign.toml").read_text())
    summary = run_fleet(other, tmp_path / "out")
    assert (summary.devices, summary.set_aside) == (14, 4)
    aside = dict(pl.read_parquet(tmp_path / "out" / "quarantine.parquet").iter_rows())
    assert "'accel_x' has no finite number" in aside["SN0001"]
    assert "'accel_y' stays at 8, its extreme value" in aside["SN0002"]
    assert "accel_z reads 0.102 times what x and y read" in aside["SN0003"]  # 1 / 9.81
    assert "scale = [1, 1, 9.80665]" in aside["SN0003"]
    assert "too few positions" in aside["SN0004"] or "do not determine" in aside["SN0004"]
    with pytest.raises(ValueError, match="device 'SN0004' was set aside: accel"):
        fleet_calibration(tmp_path / "out", "SN0004")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop("position"), "column 'position' is missing"),
        (lambda t: t.drop("accel_y"), "column 'accel_y' is missing"),
        (lambda t: t.with_columns(device=pl.lit(None, pl.String)), "'device' is empty in row 0"),
        (lambda t: t.with_columns(device=pl.lit("a")), "time does not increase"),
        (lambda t: t.sort("time"), "sort the file by device and time"),
    ],
)
def test_what_is_wrong_with_the_files_is_said_in_one_line(line, tmp_path, change, message):
    folder, _ = line
    table = pl.read_parquet(sorted(folder.glob("*.parquet")))
    (tmp_path / "campaign.toml").write_text((folder / "campaign.toml").read_text())
    change(table).write_parquet(tmp_path / "line.parquet")
    with pytest.raises(ValueError) as caught:
        summary = run_fleet(tmp_path, tmp_path / "out")
        raise ValueError(str(summary.reasons))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_folder_with_another_run_is_refused(whole, tmp_path):
    write_line(tmp_path / "other", 3)
    with pytest.raises(ValueError, match="holds a run over other files"):
        run_fleet(tmp_path / "other", whole[0])


KILLED = """
import sys
import inertiax.fleet.reduce.tasks as tasks
import inertiax.fleet.pipeline as run
small = tasks.split
run.split = lambda files, columns: small(files, columns, rows=1)  # a task for each device
print("begins", flush=True)
run.run_fleet(sys.argv[1], sys.argv[2], workers=1)
"""


@pytest.mark.slow
def test_a_killed_run_goes_on_and_ends_with_the_same_table(small, by_device, tmp_path):
    """Kill −9 at two moments; every device is there once, as in an undisturbed run."""
    folder, truth = small
    # Code with callbacks is not kept.
    environment = {**os.environ, "EQX_ON_ERROR": "nan"}

    def start(out: Path) -> subprocess.Popen:
        command = [sys.executable, "-c", KILLED, str(folder), str(out)]
        return subprocess.Popen(command, env=environment)

    broken = tmp_path / "broken"
    kills = 0
    for already in (0, 4):
        process = start(broken)
        deadline = time.monotonic() + 240
        while process.poll() is None and len(list(broken.glob("parts/part-*"))) <= already:
            assert time.monotonic() < deadline
            time.sleep(0.002)
        kills += process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert kills >= 1  # the second may come when all is done
    with ends_within(240):
        by_devices(folder, broken, workers=1)
    table = read_parts(broken).collect().sort("device")
    assert table.get_column("device").to_list() == sorted(truth)
    assert table.equals(by_device)


@pytest.mark.slow
def test_worker_processes_give_the_same_table(line, whole, tmp_path):
    folder, _ = line
    with ends_within(240):
        summary = run_fleet(folder, tmp_path / "there", scheduler="local", workers=1)
    assert summary.calibrated == 14
    tables = [read_parts(f).collect().sort("device") for f in (whole[0], tmp_path / "there")]
    assert tables[0].equals(tables[1])


@pytest.mark.slow
def test_killed_dask_workers_leave_the_table_as_it_is(small, by_device, tmp_path):
    """Kill −9 of the only worker while it is at a task."""
    from dask.distributed import LocalCluster

    folder, truth = small
    broken = tmp_path / "broken"
    killed = []
    with (
        ends_within(240),
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
    ):

        def progress(done, of):
            if done == 2:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[-1], signal.SIGKILL)

        by_devices(folder, broken, scheduler=cluster.scheduler_address, progress=progress)
    assert len(killed) == 1
    table = read_parts(broken).collect().sort("device")
    assert table.get_column("device").to_list() == sorted(truth)
    assert table.equals(by_device)


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_said_so(line, tmp_path):
    from dask import config

    # Its defaults come first: without them, leaving `config.set` would take the whole section away.
    importlib.import_module("dask.distributed")

    folder, _ = line
    message = "no Dask scheduler answers at 'tcp://127.0.0.1:9'"
    # Dask's own patience is 30 s.
    with config.set({"distributed.comm.timeouts.connect": "2s"}):
        with pytest.raises(ValueError, match=message):
            run_fleet(folder, tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.slow
def test_a_scheduler_whose_workers_are_gone_is_said_so_and_the_rest_can_be_done(
    line, tmp_path, monkeypatch
):
    from dask.distributed import LocalCluster

    import inertiax.fleet.cluster as cluster

    folder, truth = line
    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    monkeypatch.setattr(cluster, "LOOK", 0.5)
    with LocalCluster(n_workers=0, processes=False, dashboard_address=None) as without:
        address = without.scheduler_address
        with pytest.raises(
            ValueError, match=r"no workers for 2 s, with 1 of 1 tasks left: start some"
        ):
            run_fleet(folder, tmp_path / "out", scheduler=address)
    run_fleet(folder, tmp_path / "out")
    assert read_parts(tmp_path / "out").collect().height == len(truth)
