"""The two problems that the solvers are timed on: dwell means of triads with errors of half a per cent."""

import numpy as np


GRAVITY, SIGMA = 9.815, 1e-4
ROWS, COLUMNS = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)


def directions() -> np.ndarray:
    faces = [s * np.eye(3)[i] for i in range(3) for s in (1.0, -1.0)]
    signs = [(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)]
    edges = [
        (a * np.eye(3)[i] + b * np.eye(3)[j]) / np.sqrt(2)
        for i in range(3) for j in range(i) for a, b in signs
    ]  # fmt: skip
    return np.array(faces + edges)


def outputs(rng: np.random.Generator, theta: np.ndarray, force: np.ndarray) -> np.ndarray:
    matrix = np.zeros((*theta.shape[:-1], 3, 3))
    matrix[..., ROWS, COLUMNS] = theta[..., 3:]
    a = force + np.einsum("...ij,...j->...i", matrix, np.broadcast_to(force, matrix.shape[:-1]))
    return a + theta[..., :3] + rng.normal(0, SIGMA, a.shape)


def constant_problem(devices: int) -> np.ndarray:
    """Outputs (devices, 18, 3), m/s²."""
    rng = np.random.default_rng(1)
    truth = rng.standard_normal((devices, 9)) * 5e-3
    return outputs(rng, truth[:, None, :].repeat(18, axis=1), directions() * GRAVITY)


def thermal_problem(
    devices: int, low: float, high: float, degree: int = 6
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (devices, 234, 3) in m/s² and temperatures in °C, for Chebyshev polynomials over the range, seven of
    them unless told."""
    rng = np.random.default_rng(2)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    soaks = np.repeat(np.linspace(middle - half + 2, middle + half - 2, 13), 18)
    temperature = soaks + rng.uniform(-2, 2, (devices, len(soaks)))
    phi = np.polynomial.chebyshev.chebvander((temperature - middle) / half, degree)
    truth = rng.standard_normal((devices, degree + 1, 9)) * 5e-3 / np.arange(1, degree + 2)[:, None]
    return outputs(rng, phi @ truth, np.tile(directions(), (13, 1)) * GRAVITY), temperature
