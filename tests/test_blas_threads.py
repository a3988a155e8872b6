"""Small products take one BLAS thread while a calibration or a diagnosis runs, and the caller's number after it."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from inertiax.numerics.blas_threads import one_blas_thread


def threads():
    """Of every BLAS library that is loaded."""
    assert (np.ones((2, 2)) @ np.ones((2, 2)))[0, 0] == 2.0  # loads it
    return {
        one["filepath"]: one["num_threads"]
        for one in threadpool_info()
        if one["user_api"] == "blas"
    }


def test_there_is_one_thread_inside_and_the_callers_number_after():
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        if not before or set(before.values()) == {1}:
            pytest.skip("this BLAS cannot be told its number of threads")
        with one_blas_thread():
            assert set(threads().values()) == {1}
        assert threads() == before


def test_it_ends_with_an_error_too_and_decorates():
    @one_blas_thread()
    def failing():
        raise ValueError(str(set(threads().values()) <= {1}))

    before = threads()
    with pytest.raises(ValueError, match="True"):
        failing()
    assert threads() == before
