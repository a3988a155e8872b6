"""Arrays that compiled programs on processors read where they lie."""

import jax
import numpy as np
import pytest

from inertiax.numerics.aligned_arrays import ALIGNMENT, empty_aligned


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int8])
@pytest.mark.parametrize("shape", [(3, 5, 7), (1,)])
def test_aligned_arrays_have_the_shape_and_begin_where_vectors_do(shape, dtype):
    x = empty_aligned(shape, dtype)
    assert (x.shape, x.dtype) == (shape, np.dtype(dtype))
    assert x.flags.c_contiguous
    assert x.flags.writeable
    assert x.ctypes.data % ALIGNMENT == 0


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="other memory is not the host's")
def test_jax_takes_no_copy_of_an_aligned_array_and_one_of_another():
    x = empty_aligned((4, 8), np.float32)
    x[:] = 1.0
    apart = empty_aligned((33,), np.float32)[1:].reshape(4, 8)
    apart[:] = 1.0
    for array, same in ((x, True), (apart, False)):
        place = jax.device_put(array, may_alias=True).unsafe_buffer_pointer()
        assert (place == array.ctypes.data) == same
