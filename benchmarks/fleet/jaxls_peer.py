"""almond-jaxls under `vmap` on the nine-parameter problem: `pip install almond-jaxls`.

Its own Levenberg-Marquardt with its default tolerances and dense Cholesky, which is its quickest linear solver here.
With JAX in 64 bits version 0.1.0 mixes integers of two widths when it makes a matrix dense; they are made one below.
"""

import statistics
import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np


TOGETHER = 256  # devices in one program; many more and LAPACK under vmap may never return
REPEATS = 5


def jaxls_time(
    a: np.ndarray, gravity: float, sigma: float, threads: int
) -> tuple[tuple[float, float], np.ndarray]:
    """Median seconds per device, by the clock and of all cores, with `threads` programs side by side; parameters.

    Raises `ImportError` where it is not installed.
    """
    import jaxls
    from loguru import logger

    logger.remove()
    _one_width_of_integers()

    class Theta(jaxls.Var[jax.Array], default_factory=lambda: jnp.zeros(9)): ...

    @jaxls.Cost.factory
    def misfit(values: jaxls.VarValues, theta: Theta, a: jax.Array) -> jax.Array:
        p = values[theta]
        f0 = (a[:, 0] - p[0]) / (1 + p[3])
        f1 = (a[:, 1] - p[1] - p[4] * f0) / (1 + p[5])
        f2 = (a[:, 2] - p[2] - p[6] * f0 - p[7] * f1) / (1 + p[8])
        return (jnp.sqrt(f0 * f0 + f1 * f1 + f2 * f2) - gravity) / sigma

    def one(mine: jax.Array) -> jax.Array:
        theta = Theta(0)
        problem = jaxls.LeastSquaresProblem([misfit(theta, mine)], [theta]).analyze()
        return problem.solve(verbose=False, linear_solver="dense_cholesky")[theta]

    chunks = [
        jnp.asarray(c) for c in np.split(a[: len(a) // TOGETHER * TOGETHER], len(a) // TOGETHER)
    ]
    solve = jax.jit(jax.vmap(one)).lower(chunks[0]).compile()
    answer = np.asarray(solve(chunks[0]))
    times = []
    for _ in range(REPEATS):
        start, used = time.perf_counter(), time.process_time()
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda c: jax.block_until_ready(solve(c)), chunks))
        times.append((time.perf_counter() - start, time.process_time() - used))
    clock, cores = (
        statistics.median(t) / (len(chunks) * TOGETHER) for t in zip(*times, strict=True)
    )
    return (clock, cores), answer


def _one_width_of_integers() -> None:
    plain = jax.lax.dynamic_update_slice

    def narrow(operand, update, start_indices, **rest):
        return plain(operand, update, [jnp.asarray(i, jnp.int32) for i in start_indices], **rest)

    jax.lax.dynamic_update_slice = narrow
