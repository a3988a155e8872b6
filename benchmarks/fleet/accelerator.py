"""The two problems on an accelerator: equal to the processor's answers, throughput, share of the memory bandwidth."""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from problem import constant_problem, GRAVITY, SIGMA, thermal_problem

from inertiax.fleet import fit_invariant, fit_thermal_invariant
from inertiax.fleet.solve.invariant import BatchFit
from inertiax.physics.temperature import Polynomial


REPEATS = 7
THERMAL = 4096  # devices of the thermal problem
COPIED = 2**27  # numbers, to tell the bandwidth


def accelerator_table(
    devices: int,
    file: Path | None,
    *,
    thermal_devices: int = THERMAL,
    degree: int = 6,
    copied: int = COPIED,
) -> None:
    """Print both problems' figures, and write them as JSON where a file is named."""
    print(f"{jax.devices()[0].device_kind}, float64, medians of {REPEATS}\n")
    bandwidth = copy_bandwidth(copied)
    result = {
        "device": jax.devices()[0].device_kind,
        "bandwidth_GBps": bandwidth,
        "constant": constant(devices),
        "thermal": thermal(thermal_devices, degree),
    }
    print(
        "| problem | devices | devices/s | share of bandwidth | from the processor's, relative |\n|---|---|---|---|---|"
    )
    for name in ("constant", "thermal"):
        found = result[name]
        share = found["bytes"] / found["seconds"] / bandwidth / 1e9
        print(f"| {name} | {found['devices']} | {found['devices'] / found['seconds']:.3g} | {share:.1%} | "
              f"{found['difference']:.1e} |")  # fmt: skip
    if file is not None:
        file.write_text(json.dumps(result, indent=1))


def median(run: Callable[[], object]) -> float:
    jax.block_until_ready(run())
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(run())
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def copy_bandwidth(count: int) -> float:
    """GB/s of reading and writing a large array."""
    large = jnp.zeros(count)
    add = jax.jit(lambda x: x + 1.0)
    return 2 * large.nbytes / median(lambda: add(large)) / 1e9


def compared(
    solve: Callable[..., BatchFit], arguments: tuple[np.ndarray, ...], few: Callable
) -> dict[str, float]:
    """Seconds on the accelerator with the arguments there already; the first devices also on the processor."""
    there = [jax.device_put(x) for x in arguments]
    run = jax.jit(solve)
    seconds = median(lambda: run(*there))
    fit = run(*there)
    processor = jax.devices("cpu")[0]
    with jax.default_device(processor):
        same = jax.jit(solve)(*(jax.device_put(few(x), processor) for x in arguments))
    count = same.parameters.shape[0]
    size = np.abs(np.asarray(same.parameters)).max()
    difference = (
        np.abs(np.asarray(fit.parameters)[:count] - np.asarray(same.parameters)).max() / size
    )
    assert bool(np.asarray(fit.converged).all())
    moved = sum(x.nbytes for x in (*there, *jax.tree.leaves(fit)))
    return {
        "devices": len(fit.parameters),
        "seconds": seconds,
        "bytes": moved,
        "difference": float(difference),
    }


def constant(devices: int) -> dict[str, float]:
    outputs = np.ascontiguousarray(constant_problem(devices).transpose(2, 1, 0))
    weights = np.full(outputs.shape[1:], 1 / SIGMA)
    solve = lambda a, w: fit_invariant(a, w, jnp.asarray(GRAVITY))
    return compared(solve, (outputs, weights), lambda x: x[..., :256])


def thermal(devices: int, degree: int) -> dict[str, float]:
    basis = Polynomial(degree, -60.0, 60.0)
    outputs, temperature = thermal_problem(devices, basis.low, basis.high, degree)
    weights = np.full(temperature.shape, 1 / SIGMA)
    solve = lambda a, t, w: fit_thermal_invariant(
        a, t, w, jnp.asarray(GRAVITY), basis, tolerance=1e-9
    )
    return compared(solve, (outputs, temperature, weights), lambda x: x[:16])
