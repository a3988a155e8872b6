"""The founding paper's experiment, simulated end to end: three sets of measurements and a check.

Set 1, 2 and 3 are 13 experiments of 18 positions from −55 to +60 °C in which the temperature changes by
15, 4 and 0.5 °C; the check is 8 positions at +20 °C while the chamber warms by 2 °C/min. Every set is
calibrated in four ways: the traditional one (an experiment's parameters belong to its mean
temperature), the paper's procedure after two iterations, the default and the joint fit.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..estimators import Invariant
from ..physics.error_model import compensate_accel
from ..physics.temperature import Curve, Polynomial
from ..procedure.convergence import convergence_rate, rate_warning
from ..procedure.experiment_sets import ExperimentPass
from ..procedure.single_device import iterate_one, joint_fit_one
from ..procedure.thermal_iterations import PaperIteration
from ..reduction.dwells import Dwells
from ..simulate.bench import simulate_dwells, simulate_recordings
from ..simulate.plan import paper_check, PAPER_GRAVITY, paper_set, Plan
from ..simulate.triad import Device, draw_accelerometers


CHANGES = (15.0, 4.0, 0.5)  # °C inside an experiment, of the paper's sets 1, 2 and 3
METHODS = ("traditional", "paper, 2 iterations", "gauss-newton (default)", "joint fit")
DEGREE = 6

_ARCSEC = np.rad2deg(1.0) * 3600.0
_SCALE = [3, 5, 8]  # columns of the invariant estimator's vector with the scale-factor errors


class DemoSet(eqx.Module):
    """One set of measurements and its four calibrations."""

    change: float = eqx.field(static=True)  # °C inside an experiment
    plan: Plan
    dwells: Dwells
    coefficients: Float[np.ndarray, "methods size parameters"]
    deviations: Float[np.ndarray, "grid parameters"]  # 1 sigma of the default's curves
    point_temperature: Float[np.ndarray, " experiments"]  # °C
    points: Float[np.ndarray, "experiments parameters"]  # single experiments, after the last pass
    check_misfit: Float[np.ndarray, "methods check"]  # |a| − g, m/s²
    paper_radius: float = eqx.field(static=True)  # spectral radius of the paper's iteration
    iterations: int = eqx.field(static=True)  # of the default
    warning: str | None = eqx.field(static=True)


class DemoRow(eqx.Module):
    """One line of the demo's table; differences are the greatest over the temperature grid."""

    change: float = eqx.field(static=True)  # °C inside an experiment
    method: str = eqx.field(static=True)
    bias_from_truth: float = eqx.field(static=True)  # m/s²
    scale_from_truth: float = eqx.field(static=True)  # relative
    bias_from_set3: float = eqx.field(static=True)  # m/s²
    scale_from_set3: float = eqx.field(static=True)  # relative
    check: float = eqx.field(static=True)  # greatest ||a| − g|, m/s²

    @property
    def check_arcsec(self) -> float:
        """The check as an angle, arc seconds of g."""
        return self.check / PAPER_GRAVITY * _ARCSEC


class DemoResult(eqx.Module):
    """Everything that the demo's table and figures show."""

    names: tuple[str, ...] = eqx.field(static=True)  # of the parameters
    basis: Polynomial
    grid: Float[np.ndarray, " grid"]  # °C
    truth: Float[np.ndarray, "grid parameters"]
    sets: tuple[DemoSet, ...]
    check_time: Float[np.ndarray, " check"]  # s
    check_temperature: Float[np.ndarray, " check"]  # °C
    table: tuple[DemoRow, ...]

    def curves(self, number: int, method: int) -> Float[np.ndarray, "grid parameters"]:
        """Fitted curves over the grid, of set 1, 2 or 3 and method 0…3."""
        return _curves(self.basis, self.sets[number - 1].coefficients[method], self.grid)


def _curves(basis: Polynomial, coefficients: np.ndarray, grid: np.ndarray) -> np.ndarray:
    return np.asarray(jax.vmap(Curve(basis, jnp.asarray(coefficients)))(jnp.asarray(grid)))


def run_demo(
    *,
    seed: int = 0,
    drift: str = "centred",
    progress: Callable[[str], None] | None = None,
) -> DemoResult:
    """Simulate the three sets and the check, and calibrate them; `seed` draws device and noise.

    `drift` is the shape of the temperature inside an experiment, see `simulate.chamber`.
    """
    tell = progress if progress is not None else lambda _: None
    key = jax.random.PRNGKey(seed)
    device = Device(accel=draw_accelerometers(jax.random.fold_in(key, 0)))
    truth_curve = device.accel.curve  # pyright: ignore[reportOptionalMemberAccess]
    estimator = Invariant(gravity=PAPER_GRAVITY)
    tell("simulating three sets of 13 experiments with 18 positions")
    plans = [paper_set(n, drift=drift) for n in (1, 2, 3)]
    simulated = [
        simulate_dwells(jax.random.fold_in(key, n), plan, device)[0]
        for n, plan in enumerate(plans, start=1)
    ]
    temperatures = np.concatenate([np.asarray(d.temperature) for d in simulated])
    basis = Polynomial(DEGREE, float(temperatures.min()), float(temperatures.max()))
    narrowest = np.asarray(simulated[2].temperature)
    grid = np.linspace(narrowest.min(), narrowest.max(), 231)
    check_time, check_temperature, check_outputs = _check(jax.random.fold_in(key, 9), device)
    sets = []
    for change, plan, dwells in zip(CHANGES, plans, simulated, strict=True):
        tell(f"calibrating the set with {change:g} °C inside an experiment, in four ways")
        sets.append(
            _calibrate_set(
                estimator, basis, change, plan, dwells, grid, check_temperature, check_outputs
            )
        )
    truth = np.asarray(jax.vmap(truth_curve)(jnp.asarray(grid)))
    return DemoResult(
        names=estimator.names,
        basis=basis,
        grid=grid,
        truth=truth,
        sets=tuple(sets),
        check_time=check_time,
        check_temperature=check_temperature,
        table=_table(basis, grid, truth, sets),
    )


def _check(key: jax.Array, device: Device) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The check's samples at rest, one a second: time (s), temperature (°C), outputs (m/s²)."""
    recordings, _ = simulate_recordings(key, paper_check(), device, sample_rate=1.0)
    recording = recordings[0]
    assert recording.position is not None
    assert recording.accel is not None and recording.temperature is not None
    rest = recording.position >= 0
    return recording.time[rest], recording.temperature[rest, 0], recording.accel[rest]


def _calibrate_set(
    estimator: Invariant,
    basis: Polynomial,
    change: float,
    plan: Plan,
    dwells: Dwells,
    grid: np.ndarray,
    check_temperature: np.ndarray,
    check_outputs: np.ndarray,
) -> DemoSet:
    # [0] is the constant start, [1] the traditional calibration, [3] two iterations on it.
    by_experiment = ExperimentPass(estimator, basis, dwells)
    passes = [by_experiment.problem.start()]
    for _ in range(3):
        passes.append(by_experiment.refine(passes[-1]))
    default = iterate_one(estimator, basis, dwells)
    joint = joint_fit_one(estimator, basis, dwells)
    answer = np.asarray(default.curve.coefficients)
    coefficients = np.stack([passes[1], passes[3], answer, np.asarray(joint.curve.coefficients)])
    paper = PaperIteration.plan(estimator, basis, dwells)
    rate = convergence_rate(paper, joint.curve.coefficients, dwells)
    deviations = _deviations(basis, default.covariance, estimator.num_parameters, grid)
    misfit = _check_misfit(estimator, basis, coefficients, check_temperature, check_outputs)
    return DemoSet(
        change=change,
        plan=plan,
        dwells=dwells,
        coefficients=coefficients,
        deviations=deviations,
        point_temperature=by_experiment.means,
        points=by_experiment.sets(answer),
        check_misfit=np.asarray(misfit),
        paper_radius=rate.radius,
        iterations=int(default.num_iterations),
        warning=rate_warning(paper, rate, dwells),
    )


def _deviations(basis: Polynomial, covariance, count: int, grid: np.ndarray) -> np.ndarray:
    phi = np.asarray(jax.vmap(basis)(jnp.asarray(grid)))
    blocks = np.asarray(covariance).reshape(basis.size, count, basis.size, count)
    return np.sqrt(np.einsum("ga,aibi,gb->gi", phi, blocks, phi))


@eqx.filter_jit
def _check_misfit(estimator: Invariant, basis: Polynomial, coefficients, temperature, outputs):
    """|a| − g of every check sample, for every method's curves."""

    def one(c, t, a):
        force = compensate_accel(estimator.unpack(Curve(basis, c)(t)), a)
        return jnp.linalg.norm(force) - estimator.gravity

    over_samples = jax.vmap(one, in_axes=(None, 0, 0))
    return jax.vmap(over_samples, in_axes=(0, None, None))(
        coefficients, jnp.asarray(temperature), jnp.asarray(outputs)
    )


def _table(
    basis: Polynomial, grid: np.ndarray, truth: np.ndarray, sets: list[DemoSet]
) -> tuple[DemoRow, ...]:
    greatest = lambda difference, columns: float(np.max(np.abs(difference[:, columns])))
    rows = []
    for demo_set in sets:
        for number, method in enumerate(METHODS):
            curves = _curves(basis, demo_set.coefficients[number], grid)
            third = _curves(basis, sets[2].coefficients[number], grid)
            rows.append(
                DemoRow(
                    change=demo_set.change,
                    method=method,
                    bias_from_truth=greatest(curves - truth, [0, 1, 2]),
                    scale_from_truth=greatest(curves - truth, _SCALE),
                    bias_from_set3=greatest(curves - third, [0, 1, 2]),
                    scale_from_set3=greatest(curves - third, _SCALE),
                    check=float(np.max(np.abs(demo_set.check_misfit[number]))),
                )
            )
    return tuple(rows)
