"""Local parabolas against SciPy's filter of Savitzky and Golay."""

import numpy as np
import pytest
import scipy.signal

from inertiax.numerics import local_parabola as module
from inertiax.numerics.local_parabola import local_parabola


@pytest.mark.parametrize("width", [5, 21, 301])
@pytest.mark.parametrize("direct", [1e7, 0.0])
def test_values_and_slopes_are_scipys(monkeypatch, width, direct):
    monkeypatch.setattr(module, "DIRECT", direct)
    rng = np.random.default_rng(0)
    values = 300.0 + 20.0 * np.sin(np.arange(301) / 30.0) + rng.standard_normal(301)
    smooth = scipy.signal.savgol_filter(values, width, 2)
    slope = scipy.signal.savgol_filter(values, width, 2, deriv=1, delta=0.25)
    # Rounding of numbers of 300, which SciPy fits by powers of up to 150 at the ends.
    np.testing.assert_allclose(local_parabola(values, width), smooth, rtol=1e-11)
    np.testing.assert_allclose(local_parabola(values, width, 0.25), slope, rtol=0.0, atol=1e-10)
