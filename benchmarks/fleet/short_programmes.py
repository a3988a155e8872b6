"""What a line's prior is worth to devices of short programmes: errors with it, without it, and of the mean alone.

    pip install -e .
    python benchmarks/fleet/short_programmes.py [--line 200] [--devices 200] [--json FILE]

A line of devices is simulated in NumPy: bias 3 mg and scale and misalignment 3000 ppm between devices (1 sigma),
0.3 and 0.1 of that in the linear and quadratic term over -30 ... 60 °C, each coefficient correlated by 0.5 with one
factor common to all (mounting stress, say), a mean of the same size. `--line` devices run the full programme
(18 positions at 4 temperatures) and tell the population. Then `--devices` new ones run 6, 9, 12 or 18
positions at one temperature (20 °C) or two (0 and 45 °C), with 0.03 mg of noise in a dwell's mean.

*with prior*: all 27 unknowns with the population. *without*: the highest degree in temperature that the
programme determines (none: not determined). *mean*: the line's mean for every device. Errors: rms of the
curves over -30 ... 60 °C and over all devices. *inside*: parts of all coefficients within their 95 % intervals.

A second table tells *inside* for populations of few devices, nine positions at one temperature, six lines each.
"""

import argparse
import json

import jax
import numpy as np

from inertiax.estimators import Invariant
from inertiax.fleet import between_devices, fit_fleet, stack_dwells, TriadPopulation
from inertiax.fleet.population.empirical_bayes import fit_informed
from inertiax.fleet.population.population import lower_triangle
from inertiax.fleet.solve.triad_model import basis_of, curves, TriadModel
from inertiax.physics.temperature import AbstractBasis, Constant, Polynomial
from inertiax.reduction.dwells import Dwells


GRAVITY, SIGMA = 9.815, 3e-4  # m/s²
ROWS, COLUMNS = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)
LOW, HIGH, DEGREE = -30.0, 60.0, 2
FULL = (-25.0, 5.0, 30.0, 55.0)
GRID = np.linspace(LOW, HIGH, 19)
SPREAD = np.concatenate([np.r_[np.full(3, 3e-2), np.full(6, 3e-3)] * k for k in (1.0, 0.3, 0.1)])


def directions() -> np.ndarray:
    """Six faces of a cube, then its twelve edges, one of each plane after the other."""
    faces = [s * np.eye(3)[i] for i in range(3) for s in (1.0, -1.0)]
    signs = [(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)]
    edges = [
        (a * np.eye(3)[i] + b * np.eye(3)[j]) / np.sqrt(2)
        for a, b in signs for i in range(3) for j in range(i)
    ]  # fmt: skip
    return np.array(faces + edges)


def line(rng: np.random.Generator, mean: np.ndarray, devices: int) -> np.ndarray:
    common = np.sqrt(0.5) * rng.standard_normal((devices, 1))
    return mean + SPREAD * (common + np.sqrt(0.5) * rng.standard_normal((devices, 27)))


def dwells(rng: np.random.Generator, truth: np.ndarray, model: TriadModel, positions, at) -> Dwells:
    """Dwell means of one device."""
    force = GRAVITY * np.tile(directions()[:positions], (len(at), 1))
    count = len(force)
    temperature = np.repeat(np.array(at), positions) + rng.uniform(-0.5, 0.5, count)
    theta = curves(model, truth, temperature)
    matrix = np.zeros((count, 3, 3))
    matrix[:, ROWS, COLUMNS] = theta[:, 3:]
    output = force + np.einsum("nij,nj->ni", matrix, force) + theta[:, :3]
    return Dwells(
        time=10.0 * np.arange(count),
        duration=np.full(count, 8.0),
        count=np.full(count, 800.0),
        temperature=temperature,
        experiment=np.repeat(np.arange(len(at)), positions),
        position=np.tile(np.arange(positions), len(at)),
        valid=np.ones(count, bool),
        accel=output + rng.normal(0, SIGMA, output.shape),
        accel_covariance=np.broadcast_to(SIGMA**2 * np.eye(3), (count, 3, 3)).copy(),
    )


def population(rng: np.random.Generator, truth: np.ndarray, model: TriadModel) -> TriadPopulation:
    measured = stack_dwells([dwells(rng, t, model, 18, FULL) for t in truth])
    fit = fit_fleet(Invariant(GRAVITY), basis_of(model), measured)
    found = between_devices(fit.parameters, fit.covariance)
    return TriadPopulation(
        model,
        tuple(found.mean.tolist()),
        lower_triangle(found.covariance),
        lower_triangle(found.mean_covariance),
        float(np.median(fit.scatter)),
        int(found.kept.sum()),
        found.shrinkage,
    )


def highest(positions: int, temperatures: int) -> AbstractBasis | None:
    """The basis that a programme determines without a prior; nine positions determine nine parameters."""
    if positions < 9:
        return None
    return Constant() if temperatures == 1 else Polynomial(1, LOW, HIGH)


def rms(error: np.ndarray) -> tuple[float, float]:
    """Of bias in 1e-6 m/s² and of the matrix in ppm."""
    return tuple(
        1e6 * float(np.sqrt(np.square(part).mean())) for part in (error[..., :3], error[..., 3:])
    )


def row(rng, model, prior, truth, positions: int, at: tuple[float, ...]) -> dict:
    measured = stack_dwells([dwells(rng, t, model, positions, at) for t in truth])
    exact = curves(model, truth, GRID)
    informed = fit_informed(Invariant(GRAVITY), basis_of(model), measured, prior)
    sigma = np.sqrt(np.diagonal(informed.fit.covariance, axis1=1, axis2=2))
    inside = np.abs(informed.fit.parameters - truth) < 1.959964 * sigma
    basis = highest(positions, len(at))
    alone = None
    if basis is not None:
        fit = fit_fleet(Invariant(GRAVITY), basis, measured)
        same = TriadModel("invariant", model.names, basis.size - 1, LOW, HIGH)
        alone = rms(curves(same, fit.parameters, GRID) - exact)
    return {
        "positions": positions,
        "temperatures": len(at),
        "with_prior": rms(curves(model, informed.fit.parameters, GRID) - exact),
        "without": alone,
        "mean": rms(prior.mean_curves(GRID) - exact),
        "inside_95": float(inside.mean()),
        "told": float(np.median(informed.told)),
    }


def coverage(model: TriadModel, devices: int) -> list[float]:
    """Of several lines, the part of coefficients inside their 95 % intervals with a prior of few devices."""
    parts = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        mean = SPREAD * rng.standard_normal(27)
        prior = population(rng, line(rng, mean, devices), model)
        parts.append(row(rng, model, prior, line(rng, mean, 64), 9, (20.0,))["inside_95"])
    return parts


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--line", type=int, default=200)
    parser.add_argument("--devices", type=int, default=200)
    parser.add_argument("--json")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(20261121)
    model = TriadModel("invariant", Invariant(GRAVITY).names, DEGREE, LOW, HIGH)
    mean = SPREAD * rng.standard_normal(27)
    prior = population(rng, line(rng, mean, options.line), model)
    truth = line(rng, mean, options.devices)
    print(f"population of {prior.devices} devices, correlations shrunk by {prior.shrinkage:.3f}")
    print("rms error of the curves: bias in 1e-6 m/s², matrix in ppm")
    print(" positions  temperatures     with prior        without           mean    inside  told")
    rows = []
    for at in ((20.0,), (0.0, 45.0)):
        for positions in (6, 9, 12, 18):
            found = row(rng, model, prior, truth, positions, at)
            rows.append(found)
            pair = lambda v: "       -      -" if v is None else f"{v[0]:8.0f}{v[1]:7.0f}"
            print(
                f"{positions:10d}{len(at):14d}{pair(found['with_prior'])}{pair(found['without'])}"
                f"{pair(found['mean'])}{found['inside_95']:10.3f}{found['told']:6.1f}"
            )
    few = {count: coverage(model, count) for count in (8, 20, 60)}
    print("inside with a prior of few devices: mean, least and greatest of six lines")
    for count, parts in few.items():
        print(f"{count:10d}{np.mean(parts):8.3f}{min(parts):8.3f}{max(parts):8.3f}")
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump({"rows": rows, "few": few}, file, indent=1)


if __name__ == "__main__":
    main()
