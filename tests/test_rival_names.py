"""Parameters that would be others under another name are as uncertain as the names are."""

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose.pipeline import diagnose_campaign


G = 9.81
FACES = np.concatenate([np.eye(3), -np.eye(3)])
CORNERS = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / np.sqrt(3.0)
SQUARE, SIZE = 2, 0.012  # axis, m/s² at 1 g
SHAPES = {"second_order": np.square, "scale_asymmetry": np.abs}


def _campaign(seed):
    """Faces and corners three times over, each rest with an offset of its own, and a term in the square of z."""
    rng = np.random.default_rng(seed)
    up = np.concatenate([FACES, CORNERS] * 3)
    output = G * up + 0.05
    output[:, SQUARE] += SIZE * up[:, SQUARE] ** 2
    output = output + rng.normal(0.0, 1e-3, output.shape)
    samples = np.repeat(output, 25, axis=0) + rng.normal(0.0, 2e-3, (25 * len(up), 3))
    number = np.repeat(np.arange(len(up)), 25)
    time = 0.1 * np.tile(np.arange(25), len(up)) + 10.0 * number
    recording = Recording(time=time, accel=samples, position=number)
    return Campaign((recording,), Site(gravity=G), model=ModelChoice(temperature_degree=0)), output


def _bias(output, shape):
    """Bias of z by SciPy, beside a term of that shape in the true force."""
    rows, columns = np.tril_indices(3)

    def misfit(x):
        matrix = np.eye(3)
        matrix[rows, columns] += x[3:9]
        force = np.linalg.solve(matrix, (output - x[:3]).T).T
        added = np.zeros_like(output)
        added[:, SQUARE] = x[9] * shape(force[:, SQUARE] / G)
        return np.linalg.norm(np.linalg.solve(matrix, (output - x[:3] - added).T).T, axis=1) - G

    return least_squares(misfit, np.zeros(10)).x[SQUARE]


@pytest.mark.slow
def test_a_bias_is_as_uncertain_as_the_name_that_it_depends_on():
    campaign, output = _campaign(4)
    with jax.enable_x64(True):
        found, written = diagnose_campaign(campaign)
    (effect,) = found.effects
    odds = dict(effect.odds)
    # With two sizes of a component, |f| and f² differ in the bias alone.
    assert set(SHAPES) <= set(odds)
    apart = abs(_bias(output, np.square) - _bias(output, np.abs))
    assert apart > 1e-3  # several standard deviations of either
    (sigma,) = np.sqrt(np.diag(np.asarray(written.accel.covariance))[[SQUARE]])
    other = next(n for n in SHAPES if n != effect.name)
    # Its own part, another hundredth of what rows weighted otherwise give, and further names add to that.
    assert sigma > 0.9 * np.sqrt(odds[other]) * apart
    assert sigma < apart
