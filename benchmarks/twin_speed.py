"""How fast a digital twin makes samples: one device in `scan`, a thousand under `vmap`, by the noise it has.

    python benchmarks/twin_speed.py [--devices 1000] [--samples 20000]

Times are of the processor (all threads together), by the clock on an accelerator, the least of five runs, so that
other work on the machine counts little; compilation is left out. The calibration has both triads with polynomials of
degree 3.

Measured on one core of an AMD EPYC and in brackets before flicker was made by one number a sample
(`navigation.one_innovation`) and the error model without products of small matrices (JAX 0.10.2, 32 bits, the two in
turn):

    noise        scan, µs a sample     vmap, samples a processor second
    none         0.03 (0.73)           5.4e7 (1.1e7)
    N            0.52 (0.92)           2.1e7 (0.81e7)
    N, B and K   0.92 (1.44)           0.71e7 (0.32e7)

Both cores without other work: 1.26e7 samples a second of the clock with all three for 4000 devices, 0.83 to 1.09e7 for
1000 (0.30e7 before). Asked were 5 µs in `scan` and 10⁷ a second under `vmap`.

Before, 20 000 devices on one NVIDIA H100 (JAX 0.11.2, 32 bits) made 8.5e8, 6.8e8 and 8.3e8 samples a second.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import inertiax as ix


NOISE = {
    "none": None,
    "N": {"accel": {"N": 1e-3}, "gyro": {"N": 1e-4}},
    "N, B and K": {
        "accel": {"N": 1e-3, "B": 1e-4, "K": 1e-5},
        "gyro": {"N": 1e-4, "B": 1e-5, "K": 1e-6},
    },
}


def _calibration() -> ix.Calibration:
    basis = ix.Polynomial(3, -40.0, 70.0)
    places = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)]

    def triad(name: str) -> ix.TriadCalibration:
        names = tuple(f"{name}.{k}" for k in [*(f"bias[{i}]" for i in range(3)), *places])
        curve = ix.Curve(basis, np.full((4, 12), 1e-3))
        return ix.TriadCalibration(curve, np.zeros((48, 48)), names, "reference")

    return ix.Calibration(9.81, triad("accel"), triad("gyro"))


def _inputs(samples: int) -> tuple[jax.Array, ...]:
    force = jnp.tile(jnp.array([0.1, -0.2, 9.8]), (samples, 1))
    return force, 0.1 * force, jnp.linspace(20.0, 21.0, samples)


def one(twin: ix.Twin, key: jax.Array, inputs: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Outputs of a run."""
    start = twin.init(key, 20.0)
    return jax.lax.scan(lambda s, x: twin.step(s, *x), start, inputs)[1]


def many(twin: ix.Twin, keys: jax.Array, inputs: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Sums of the outputs of many devices, each with a bias of its own, so that nothing is computed once for all."""

    def device(key: jax.Array) -> tuple[jax.Array, ...]:
        off = jax.random.normal(key, (6,))
        moved = twin.calibration.with_values("*.bias.c0", off)
        own = ix.Twin(moved, twin.noise, twin.sample_rate)
        start = own.init(key, 20.0)

        def step(carried: tuple[ix.TwinState, Any], sample: tuple) -> tuple:
            state, outputs = own.step(carried[0], *sample)
            return (state, jax.tree.map(jnp.add, carried[1], outputs)), None

        return jax.lax.scan(step, (start, (jnp.zeros(3), jnp.zeros(3))), inputs)[0][1]

    return jax.vmap(device)(keys)


def least(run: Callable[..., object], *given: object) -> float:
    """Processor time of the quickest of five runs, s; by the clock on an accelerator."""
    clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
    jax.block_until_ready(run(*given))
    times = []
    for _ in range(5):
        before = clock()
        jax.block_until_ready(run(*given))
        times.append(clock() - before)
    return min(times)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Speed of the digital twin.")
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=20_000)
    given = parser.parse_args()
    print(f"{'noise':<12}{'scan, µs a sample':>20}{'vmap, samples a processor second':>36}")
    inputs, short = _inputs(given.samples), _inputs(100)
    key = jax.random.PRNGKey(0)
    keys = jax.random.split(key, given.devices)
    alone, vmapped = jax.jit(one), jax.jit(many)
    for name, noise in NOISE.items():
        twin = ix.Twin(_calibration(), noise, sample_rate=100.0)
        scan = least(alone, twin, key, inputs) / given.samples
        batch = given.devices * 100 / least(vmapped, twin, keys, short)
        print(f"{name:<12}{1e6 * scan:>20.2f}{batch:>36.2e}", flush=True)


if __name__ == "__main__":
    main()
