"""A small production line in plain NumPy: raw Parquet of many accelerometers with known parameters."""

from pathlib import Path

import numpy as np
import polars as pl

from inertiax.reduction.dwells import Dwells


GRAVITY = 9.815
ROWS, COLUMNS = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)
NOISE = 2e-3  # m/s², one sample
SAMPLES = 64  # of a dwell
LOW, HIGH = -30.0, 60.0
SIGMA = 1e-4  # m/s² of a dwell's mean


def directions() -> np.ndarray:
    """The 18 directions of faces and edges of a cube."""
    faces = [s * np.eye(3)[i] for i in range(3) for s in (1.0, -1.0)]
    edges = [
        (a * np.eye(3)[i] + b * np.eye(3)[j]) / np.sqrt(2)
        for i in range(3)
        for j in range(i)
        for a in (1.0, -1.0)
        for b in (1.0, -1.0)
    ]
    return np.array(faces + edges)


def parameters(rng: np.random.Generator, degree: int) -> np.ndarray:
    """Coefficients (degree + 1, 9): bias in m/s², then the lower triangle of the matrix."""
    size = np.array([1.0, 0.3, 0.1])[: degree + 1, None] * 3e-3
    values = rng.standard_normal((degree + 1, 9)) * size
    values[:, :3] *= GRAVITY
    return values


def dwell_means(
    rng: np.random.Generator, truth: np.ndarray, experiments: int
) -> tuple[np.ndarray, np.ndarray]:
    """Noise-free outputs and temperatures of each experiment's 18 positions."""
    u = directions()
    ramp = np.tile(np.linspace(-2.0, 2.0, len(u)), experiments)
    temperature = np.repeat(np.linspace(LOW + 2, HIGH - 2, experiments), len(u)) + ramp
    x = (2 * temperature - LOW - HIGH) / (HIGH - LOW)
    phi = np.stack([np.ones_like(x), x, 2 * x**2 - 1], axis=1)[:, : len(truth)]
    theta = phi @ truth
    force = np.tile(u, (experiments, 1)) * GRAVITY
    matrix = np.zeros((len(x), 3, 3))
    matrix[:, ROWS, COLUMNS] = theta[:, 3:]
    return force + np.einsum("nij,nj->ni", matrix, force) + theta[:, :3], temperature


def device_table(
    rng: np.random.Generator, name: str, truth: np.ndarray, experiments: int
) -> pl.DataFrame:
    """Raw samples of one device, in the canonical columns."""
    outputs, temperature = dwell_means(rng, truth, experiments)
    num = len(temperature)
    samples = np.repeat(outputs, SAMPLES, axis=0) + rng.normal(0, NOISE, (num * SAMPLES, 3))
    label = lambda v: np.repeat(v, SAMPLES).astype(np.int32)
    columns: dict[str, object] = {
        "time": np.arange(num * SAMPLES) * 0.01,
        "device": [name] * (num * SAMPLES),
        "experiment": label(np.repeat(np.arange(experiments), 18)),
        "position": label(np.tile(np.arange(18), experiments)),
        "temperature": np.repeat(temperature, SAMPLES),
    }
    return pl.DataFrame(columns | {f"accel_{c}": samples[:, i] for i, c in enumerate("xyz")})


def write_line(
    folder: Path, devices: int, *, files: int = 2, experiments: int = 4, degree: int = 1
) -> dict[str, np.ndarray]:
    """A campaign folder of so many devices; returns the true coefficients by serial number."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(20260411)
    truth = {f"SN{k:04d}": parameters(rng, degree) for k in range(devices)}
    tables = [device_table(rng, name, t, experiments) for name, t in truth.items()]
    for k in range(files):
        pl.concat(tables[k::files]).write_parquet(folder / f"line-{k}.parquet", row_group_size=5000)
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.parquet"]\n'
        f'[model]\naccel_estimator = "invariant"\ntemperature_degree = {degree}\n'
    )
    return truth


def _dwells(rng: np.random.Generator, truth: np.ndarray, experiments: int) -> Dwells:
    outputs, temperature = dwell_means(rng, truth, experiments)
    num = len(outputs)
    return Dwells(
        time=np.arange(num) * 10.0,
        duration=np.full(num, 5.0),
        count=np.full(num, 100.0),
        temperature=temperature,
        experiment=np.repeat(np.arange(experiments), 18),
        position=np.tile(np.arange(18), experiments),
        valid=np.ones(num, bool),
        accel=outputs + rng.normal(0, SIGMA, outputs.shape),
        accel_covariance=np.broadcast_to(np.eye(3) * SIGMA**2, (num, 3, 3)).copy(),
    )


def simulated_dwells(degree: int, count: int) -> tuple[list[Dwells], np.ndarray]:
    rng = np.random.default_rng(5)
    truth = [parameters(rng, degree) for _ in range(count)]
    return [_dwells(rng, t, 4 if degree else 1) for t in truth], np.array(truth)
