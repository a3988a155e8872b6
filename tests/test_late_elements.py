"""Degrees at which a lag may begin a search: those whose curves the dwells determine."""

import numpy as np
import pytest

from inertiax.diagnose.late_elements import _fit, Chain


NAMES = ("gyro.bias[0]", "gyro.matrix[0,0]", "gyro.matrix[0,1]", "gyro.matrix[0,2]")
DWELLS = 16  # of each face, half of them rests


def faces():
    """One gyro on six faces in turn, of which each shows one element of its matrix."""
    rng = np.random.default_rng(3)
    rates = np.repeat(np.eye(3), 2 * DWELLS, axis=0) * rng.uniform(-3.0, 3.0, (6 * DWELLS, 1))
    rates[::2] = 0.0
    jacobian = np.column_stack([np.ones(len(rates)), rates])
    return [Chain(1e-3 * rng.standard_normal(len(rates)), jacobian, jacobian[:, :1], NAMES)]


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_faces_at_a_temperature_each_determine_no_curves_of_scale_factors(degree):
    """Two faces show an element at two temperatures, which is a line; all faces at all temperatures show curves."""
    each = np.repeat(np.linspace(-1.0, 1.0, 6), DWELLS)
    every = np.tile(np.linspace(-1.0, 1.0, DWELLS // 2).repeat(2), 6)
    for temperature, told in ((each, degree < 2), (every, True)):
        basis = np.polynomial.chebyshev.chebvander(temperature, degree)
        (chain,) = chains = faces()
        design = (chain.jacobian[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
        assert (np.linalg.matrix_rank(design) == design.shape[1]) == told
        assert (_fit(chains, basis, np.zeros((len(basis), 0))) is not None) == told
