"""Optimal temperatures of the experiments for curves over a range: D and I criteria."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from ..physics.temperature import AbstractBasis
from .criteria import log_score_slope


def optimal_temperatures(
    basis: AbstractBasis,
    count: int,
    *,
    low: float,
    high: float,
    criterion: str = "D",
    starts: int = 8,
    seed: int = 0,
) -> Float[np.ndarray, " count"]:
    """Temperatures (°C, ascending) at which `count` experiments determine curves best.

    With the same programme at every temperature, information over temperature and over positions
    factorise (their Kronecker product), so temperatures can be chosen alone: "D" for the coefficients
    (A is not offered, as coefficients are no quantities of their own), "I" for the curve's mean
    variance over `low`…`high`. Exact-gradient L-BFGS-B from equal steps and random starts.

    Raises `ValueError` where there are fewer experiments than basis functions.
    """
    if count < basis.size:
        raise ValueError(
            f"`optimal_temperatures(count={count})`: {count} temperatures cannot determine curves with "
            f"{basis.size} coefficients."
        )
    if criterion not in ("D", "I"):
        raise ValueError(f"`optimal_temperatures(criterion={criterion!r})`: it is 'D' or 'I'.")
    over = np.linspace(low, high, 201)
    grid = np.asarray(jax.vmap(basis)(jnp.asarray(over)))
    weight = grid.T @ grid / len(over)

    both = jax.jit(jax.vmap(lambda t: (basis(t), jax.jacfwd(basis)(t))))

    def evaluate(temperatures: np.ndarray) -> tuple[float, np.ndarray]:
        phi, slope = (np.asarray(x) for x in both(temperatures))
        value, by_matrix = log_score_slope(criterion, phi.T @ phi, count, weight)
        if not np.isfinite(value):
            return 1e6, np.zeros(count)
        # ∂(ΦᵀΦ)/∂t_k = φ' φᵀ + φ φ'ᵀ, and the criterion's derivative is symmetric.
        return -value, -2.0 * np.einsum("ka,ab,kb->k", slope, by_matrix, phi)

    rng = np.random.default_rng(seed)
    first = np.linspace(low, high, count)
    tried = [
        first,
        0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * (first - low) / (high - low)),
    ]
    tried += [np.sort(rng.uniform(low, high, count)) for _ in range(max(0, starts - len(tried)))]
    done = [
        minimize(evaluate, t, jac=True, method="L-BFGS-B", bounds=[(low, high)] * count,
                 options={"ftol": 1e-15, "gtol": 1e-12, "maxiter": 2000})
        for t in tried
    ]  # fmt: skip
    return np.sort(min(done, key=lambda d: d.fun).x)
