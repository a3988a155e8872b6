"""Traditional calibration and the first approach, against the truth and each other."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.analysis.reference_methods import (
    chamber_hours,
    first_approach,
    paper_passes,
    traditional,
)
from inertiax.estimators import Invariant
from inertiax.physics.temperature import Polynomial
from inertiax.procedure.single_device import joint_fit_one
from inertiax.procedure.thermal_iterations import PaperIteration, start_curve
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.chamber import Chamber
from inertiax.simulate.plan import PAPER_GRAVITY, paper_set, Plan
from inertiax.simulate.programme import Programme, PROGRAMME_18
from inertiax.simulate.triad import Device, draw_accelerometers


ESTIMATOR = Invariant(gravity=PAPER_GRAVITY)
BASIS = Polynomial(6, -70.0, 75.0)
GRID = jnp.linspace(-50.0, 55.0, 106)


@pytest.fixture(scope="module")
def device():
    return Device(accel=draw_accelerometers(jax.random.PRNGKey(0)))


def _sweep(passes=7):
    angles = np.tile(np.asarray(PROGRAMME_18.angles), (passes, 1))
    programme = Programme("repeated", angles, np.tile(np.asarray(PROGRAMME_18.numbers), passes))
    return Plan(programme, Chamber(jnp.array([-55.0]), 115.0, "one-sided"))


def _errors(curve, device):
    fitted, truth = (np.asarray(jax.vmap(c)(GRID)) for c in (curve, device.accel.curve))
    difference = np.abs(fitted - truth)
    return difference[:, :3].max(), difference[:, 3:].max()


@pytest.mark.slow
def test_traditional_needs_a_held_temperature(device):
    held, _ = simulate_dwells(jax.random.PRNGKey(1), paper_set(3), device)
    drifting, _ = simulate_dwells(jax.random.PRNGKey(1), paper_set(1), device)
    good, finite = traditional(ESTIMATOR, BASIS, held)
    bad, _ = traditional(ESTIMATOR, BASIS, drifting)
    assert finite
    good_bias, good_matrix = _errors(good, device)
    bad_bias, bad_matrix = _errors(bad, device)
    assert good_bias < 1e-4 and good_matrix < 3e-5
    assert bad_bias > 5 * good_bias and bad_matrix > 5 * good_matrix


@pytest.mark.slow
def test_passes_from_the_host_are_those_of_the_compiled_iteration(device):
    dwells, _ = simulate_dwells(jax.random.PRNGKey(1), paper_set(1), device)
    procedure = PaperIteration.plan(ESTIMATOR, BASIS, dwells)
    one_pass = jax.jit(lambda c: procedure.refine(c, dwells))
    compiled = [np.asarray(start_curve(ESTIMATOR, BASIS, dwells))]
    for _ in range(3):
        compiled.append(np.asarray(one_pass(compiled[-1])))
    np.testing.assert_allclose(
        paper_passes(ESTIMATOR, BASIS, dwells, passes=3), compiled, rtol=1e-6, atol=1e-9
    )


@pytest.mark.slow
def test_first_approach_takes_one_sweep_and_half_the_dwells(device):
    dwells, _ = simulate_dwells(jax.random.PRNGKey(2), _sweep(), device)
    assert dwells.num_dwells < 0.55 * 13 * 18
    found = first_approach(ESTIMATOR, BASIS, dwells, pieces=4)
    assert found.succeeded.all() and len(found.ranges) == 4
    bias, matrix = _errors(found.curve, device)
    # Straight pieces of 29 °C leave a bow of θ'' ΔT²/16: 1e-3 m/s² and 100 ppm are its order here.
    assert bias < 3e-3 and matrix < 5e-4
    # The same sweep by the default, with curves instead of pieces, has no such bow.
    curve_bias, curve_matrix = _errors(joint_fit_one(ESTIMATOR, BASIS, dwells).curve, device)
    assert curve_bias < bias and curve_matrix < matrix


@pytest.mark.slow
def test_first_approach_is_exact_where_dependence_is_linear():
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(4), degree=1))
    dwells, _ = simulate_dwells(None, _sweep(), device)
    basis = Polynomial(1, -70.0, 75.0)
    found = first_approach(ESTIMATOR, basis, dwells, pieces=4)
    bias, matrix = _errors(found.curve, device)
    assert bias < 1e-9 and matrix < 1e-10
    assert np.all(np.diagonal(found.covariance) > 0)


@pytest.mark.slow
def test_joined_pieces_are_as_certain_as_one_fit_at_most():
    # For a linear truth the pieces together hold what one fit of all dwells has: the same covariance.
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(4), degree=1))
    dwells, _ = simulate_dwells(None, _sweep(), device)
    basis = Polynomial(1, -70.0, 75.0)
    pieces = first_approach(ESTIMATOR, basis, dwells, pieces=4).covariance
    whole = np.asarray(joint_fit_one(ESTIMATOR, basis, dwells).covariance)
    np.testing.assert_allclose(np.sqrt(np.diagonal(pieces)), np.sqrt(np.diagonal(whole)), rtol=1e-4)


def test_pieces_that_cannot_work_are_refused(device):
    dwells, _ = simulate_dwells(None, paper_set(2), device)
    with pytest.raises(ValueError, match="6 values cannot determine curves with 7 coefficients"):
        first_approach(ESTIMATOR, BASIS, dwells, pieces=3)
    with pytest.raises(ValueError, match="7 dwells in a piece are too few for 18 unknowns"):
        first_approach(ESTIMATOR, BASIS, dwells, pieces=30)


@pytest.mark.slow
def test_traditional_refuses_too_few_experiments(device):
    dwells, _ = simulate_dwells(None, paper_set(2, temperatures=(0.0, 30.0)), device)
    with pytest.raises(ValueError, match="2 experiments cannot determine curves with 7"):
        traditional(ESTIMATOR, BASIS, eqx.tree_at(lambda d: d.position, dwells, dwells.position))


def test_chamber_hours_by_hand():
    # 13 × (1250 s + 1800 s ln 20 + 300 s) = 113 650 s; no soak where the step is allowed whole.
    args = dict(experiments=13, experiment_time=1250.0, step=10.0)
    assert chamber_hours(**args, change=0.5) == pytest.approx(
        13 * (1550 + 1800 * np.log(20)) / 3600
    )
    assert chamber_hours(**args, change=15.0) == pytest.approx(13 * 1550 / 3600)
