"""Throughput of batched solves from dwell means, beside Ceres, SciPy and a hand-vectorised bound.

    pip install -e . pyceres        # and for jaxls what jaxls_peer.py says
    python benchmarks/fleet/solve.py [--devices 20000] [--platform gpu] [--json FILE]

1. Nine parameters, 18 positions, float64, convergence tested, covariance included: `solve_chunks` on all cores, which
   begins at the ellipsoid of least algebraic error and takes steps with that one's inverse (see
   `fleet/solve/invariant.py`); Ceres through pyceres (one vector residual with analytic Jacobian, dense QR, its
   default tolerances, problem construction inside the clock, one device after the other); almond-jaxls under `vmap`
   on as many threads; and `invariant.c`, Gauss-Newton written by hand for the vector lanes (compiled here with -O3
   -march=native), on as many threads. All minimise the same sum of squares; only ours gives covariances.
2. Sixty-three parameters, 13 × 18 dwells: `fit_thermal_invariant` beside SciPy's MINPACK with analytic
   Jacobian.

With `--platform gpu` the same two problems are solved by one program each on the accelerator instead: the answers
beside those of the processor (relative to the largest of a kind), the throughput, and the share of the memory bandwidth
(that of a copy, measured here) which reading the dwells and writing the results once would take. `--check-form` does
so on the processor with few devices, to see that it runs through: its figures tell nothing of an accelerator.

Once all of it in a process that has one core, which is core for core, and once ours on all threads, where a device's
arrays move from core to core and two threads share a cache, while Ceres and SciPy have all of it for themselves.

Medians of seven, by the clock and of processor time, which other work on the machine changes less; every solver's
answers are compared before its time is told. Compile time is told apart.
"""

import argparse
import ctypes
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path


os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # peers run one device at a time

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from accelerator import accelerator_table
from jaxls_peer import jaxls_time
from problem import constant_problem, GRAVITY, SIGMA, thermal_problem

from inertiax.fleet import fit_thermal_invariant
from inertiax.fleet.solve.batch import BLOCKS, CHUNKS, LANES, solve_chunks
from inertiax.numerics.aligned_arrays import empty_aligned
from inertiax.physics.temperature import Polynomial


Timings = dict[str, dict[str, float | tuple[float, float]]]

ONE_CORE = "--one-core"
REPEATS = 7
WIDTH = 8


def median(run: Callable[[], object]) -> tuple[float, float]:
    """Seconds by the clock and of all cores together."""
    times = []
    for _ in range(REPEATS):
        start, used = time.perf_counter(), time.process_time()
        run()
        times.append((time.perf_counter() - start, time.process_time() - used))
    clock, cores = zip(*times, strict=True)
    return statistics.median(clock), statistics.median(cores)


def each(seconds: tuple[float, float], devices: int) -> tuple[float, float]:
    """Microseconds a device."""
    return seconds[0] / devices * 1e6, seconds[1] / devices * 1e6


def rows(theta: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """‖f‖ and its derivatives by the nine parameters, for the peers."""
    b, g = theta[..., :3], theta[..., 3:]
    f0 = (a[..., 0] - b[..., 0]) / (1 + g[..., 0])
    f1 = (a[..., 1] - b[..., 1] - g[..., 1] * f0) / (1 + g[..., 2])
    f2 = (a[..., 2] - b[..., 2] - g[..., 3] * f0 - g[..., 4] * f1) / (1 + g[..., 5])
    n = np.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    v2 = f2 / n / (1 + g[..., 5])
    v1 = (f1 / n - g[..., 4] * v2) / (1 + g[..., 2])
    v0 = (f0 / n - g[..., 1] * v1 - g[..., 3] * v2) / (1 + g[..., 0])
    columns = [v0, v1, v2, v0 * f0, v1 * f0, v1 * f1, v2 * f0, v2 * f1, v2 * f2]
    return n, -np.stack(columns, axis=-1)


def constant(devices: int, threads: int) -> dict[str, float | tuple[float, float]]:
    a = constant_problem(devices)
    together = LANES * CHUNKS
    padded = np.concatenate([a, a[: -devices % together]])
    calls = [empty_aligned((CHUNKS, 3, 18, LANES), float) for _ in range(len(padded) // together)]
    for call, own in zip(calls, np.split(padded, len(calls)), strict=True):
        call[:] = own.reshape(CHUNKS, LANES, 18, 3).transpose(0, 3, 2, 1)
    weights = empty_aligned((CHUNKS, 18, LANES), float)
    weights[:] = 1 / SIGMA
    gravity, used = jnp.asarray(GRAVITY), np.int32(CHUNKS)
    last = np.int32(-(-(devices - together * (len(calls) - 1)) // LANES))
    start = time.perf_counter()
    jax.block_until_ready(solve_chunks(calls[0], weights, gravity, used))
    compile_time = time.perf_counter() - start

    def ours() -> np.ndarray:
        def one(number: int) -> np.ndarray:
            count = used if number + 1 < len(calls) else last
            fit = solve_chunks(calls[number], weights, gravity, count)
            assert bool(np.asarray(fit.converged)[:count].all())
            return np.asarray(fit.parameters).reshape(-1, 9)

        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(one, range(len(calls)))))[:devices]

    answer = ours()
    seconds = median(ours)
    bound, same = bound_time(a, threads)
    sigma = SIGMA / np.sqrt(18)
    assert np.abs(same - answer)[:, :3].max() < 1e-4 * sigma
    ceres = ceres_time(a[:400], answer[:400])
    jaxls = jaxls_seconds(a[:5120], answer, threads)
    return {
        "compile_s": compile_time,
        "ours_us": each(seconds, devices),
        "bound_us": each(bound, devices),
        "ceres_us": each(ceres, 1),
        "jaxls_us": each(jaxls, 1),
    }


def jaxls_seconds(a: np.ndarray, answer: np.ndarray, threads: int) -> tuple[float, float]:
    """Median seconds per device, by the clock and of all cores; NaN where jaxls is not installed."""
    try:
        seconds, found = jaxls_time(a, GRAVITY, SIGMA, threads)
    except ImportError as error:
        print(f"without jaxls: {error}")
        return float("nan"), float("nan")
    assert np.abs(found - answer[: len(found)])[:, :3].max() < 1e-2 * SIGMA
    return seconds


def bound_time(a: np.ndarray, threads: int) -> tuple[tuple[float, float], np.ndarray]:
    folder = Path(tempfile.mkdtemp())
    source = Path(__file__).with_name("invariant.c")
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(source), "-o", str(folder / "bound.so"), "-lm"], check=True)
    fit = ctypes.CDLL(str(folder / "bound.so")).fit
    pointer = ctypes.POINTER(ctypes.c_double)
    fit.argtypes = [pointer, pointer, pointer, ctypes.c_long, ctypes.c_long, ctypes.c_double]
    blocks = -(-len(a) // WIDTH)
    padded = np.concatenate([a, a[: blocks * WIDTH - len(a)]]) / GRAVITY
    # 64-byte alignment, which the vector type asks for.
    raw = np.empty(padded.size + 8)
    offset = (-raw.ctypes.data // 8) % 8
    packed = raw[offset : offset + padded.size].reshape(blocks, 3, 18, WIDTH)
    packed[:] = padded.reshape(blocks, WIDTH, 18, 3).transpose(0, 3, 2, 1)
    weights, result = np.full(18, GRAVITY / SIGMA), np.empty((blocks, 9, WIDTH))
    parts = np.array_split(np.arange(blocks), threads)

    def run() -> None:
        def one(part: np.ndarray) -> None:
            first, count = int(part[0]), len(part)
            fit(
                packed[first:].ctypes.data_as(pointer), weights.ctypes.data_as(pointer),
                result[first:].ctypes.data_as(pointer), count, 18, 1e-6,
            )  # fmt: skip

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(one, parts))

    run()
    seconds = median(run)
    found = result.transpose(0, 2, 1).reshape(-1, 9)[: len(a)]
    return seconds, found * np.array([GRAVITY] * 3 + [1.0] * 6)


def ceres_time(a: np.ndarray, answer: np.ndarray) -> tuple[float, float]:
    """Median seconds per device of one core; NaN where pyceres is not installed."""
    try:
        import pyceres
    except ImportError:
        return float("nan"), float("nan")

    class Misfit(pyceres.CostFunction):
        def __init__(self, mine: np.ndarray):
            super().__init__()
            self.mine = mine
            self.set_num_residuals(len(mine))
            self.set_parameter_block_sizes([9])

        def Evaluate(self, parameters, residuals, jacobians):  # noqa: N802 - Ceres' own name
            size, jacobian = rows(np.asarray(parameters[0])[None], self.mine)
            residuals[:] = (size - GRAVITY) / SIGMA
            if jacobians is not None and jacobians[0] is not None:
                jacobians[0][:] = (jacobian / SIGMA).ravel()
            return True

    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_QR
    options.num_threads = 1
    options.logging_type = pyceres.LoggingType.SILENT
    times = []
    for k, mine in enumerate(a):
        start = time.process_time()
        x = np.zeros(9)
        problem = pyceres.Problem()
        cost = Misfit(mine)
        problem.add_residual_block(cost, None, [x])
        pyceres.solve(options, problem, pyceres.SolverSummary())
        times.append(time.process_time() - start)
        assert np.abs(x - answer[k])[:3].max() < 1e-2 * SIGMA
    return (statistics.median(times),) * 2


def thermal(devices: int, threads: int) -> dict[str, float | tuple[float, float]]:
    basis = Polynomial(6, -60.0, 60.0)
    a, temperature = thermal_problem(devices, basis.low, basis.high)
    phi = np.polynomial.chebyshev.chebvander(temperature / 60.0, 6)
    count = a.shape[1]
    weights = np.full((devices, count), 1 / SIGMA)
    chunks = [slice(k, k + BLOCKS) for k in range(0, devices, BLOCKS)]
    g = jnp.asarray(GRAVITY)
    solve = jax.jit(lambda x, t, w: fit_thermal_invariant(x, t, w, g, basis))
    start = time.perf_counter()
    compiled = solve.lower(a[chunks[0]], temperature[chunks[0]], weights[chunks[0]]).compile()
    compile_time = time.perf_counter() - start

    def ours() -> np.ndarray:
        def one(c: slice) -> np.ndarray:
            fit = compiled(a[c], temperature[c], weights[c])
            assert bool(np.asarray(fit.converged).all())
            return np.asarray(fit.parameters)

        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(one, chunks)))

    answer = ours()
    seconds = median(ours)
    times = []
    for k in range(20):

        def residual(c: np.ndarray, k: int = k) -> np.ndarray:
            return (rows(phi[k] @ c.reshape(7, 9), a[k])[0] - GRAVITY) / SIGMA

        def jacobian(c: np.ndarray, k: int = k) -> np.ndarray:
            row = rows(phi[k] @ c.reshape(7, 9), a[k])[1] / SIGMA
            return (phi[k][:, :, None] * row[:, None, :]).reshape(count, 63)

        start = time.process_time()
        best = scipy.optimize.least_squares(
            residual, np.zeros(63), jacobian, method="lm", x_scale="jac"
        )
        times.append(time.process_time() - start)
        assert np.abs(best.x - answer[k]).max() < 1e-3 * SIGMA
    return {
        "compile_s": compile_time,
        "ours_us": each(seconds, devices),
        "scipy_us": (statistics.median(times) * 1e6,) * 2,
    }


def on_one_core(devices: int) -> Timings:
    """Both problems in a process of its own, which has one core; XLA makes as many threads as there are cores."""
    call = [sys.executable, __file__, ONE_CORE, "--devices", str(devices)]
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # of this thread, from which the process has it
    try:
        run = subprocess.run(call, stdout=subprocess.PIPE, check=True, text=True)
    finally:
        os.sched_setaffinity(0, cores)
    return json.loads(run.stdout.splitlines()[-1])


def both(devices: int, threads: int) -> Timings:
    return {"constant": constant(devices, threads), "thermal": thermal(512, threads)}


def table(found: Timings) -> None:
    print("| problem | ours | peer | ratio | compile, s |\n|---|---|---|---|---|")
    for peer, name, problem in (
        ("ceres", "9 parameters, Ceres", "constant"),
        ("jaxls", "9 parameters, jaxls under vmap", "constant"),
        ("bound", "9 parameters, C bound", "constant"),
        ("scipy", "63 parameters, SciPy", "thermal"),
    ):
        one = found[problem]
        ours, theirs = one["ours_us"], one[f"{peer}_us"]
        print(f"| {name} | {ours[0]:.2f} / {ours[1]:.2f} | {theirs[0]:.2f} / {theirs[1]:.2f} | "
              f"{theirs[0] / ours[0]:.2f} / {theirs[1] / ours[1]:.2f} | {one['compile_s']:.1f} |")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=20_000)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--platform", choices=("cpu", "gpu"), default="cpu")
    parser.add_argument("--check-form", action="store_true")
    parser.add_argument(ONE_CORE, action="store_true", help="on one core, as JSON")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    jax.config.update(
        "jax_platforms", "cpu" if options.platform == "cpu" else f"{options.platform},cpu"
    )
    jax.config.update("jax_enable_x64", True)
    if options.check_form:
        accelerator_table(256, options.json, thermal_devices=32, degree=1, copied=2**22)
        return
    if options.one_core:
        print(json.dumps(both(options.devices, 1)))
        return
    if options.platform != "cpu":
        accelerator_table(options.devices, options.json)
        return
    many, one = both(options.devices, options.threads), on_one_core(options.devices)
    load = os.getloadavg()[0]
    print(f"{options.devices} devices, float64, medians of {REPEATS}, load {load:.1f}")
    print("µs a device by the clock / of all cores together\n")
    print("Core for core: all in a process that has one core\n")
    table(one)
    print(f"\n{options.threads} threads; Ceres and SciPy use one\n")
    table(many)
    if options.json:
        options.json.write_text(json.dumps({**many, "on_one_core": one}, indent=1))


if __name__ == "__main__":
    main()
