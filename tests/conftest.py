"""64-bit arithmetic, strict promotion, and seeded randomness for every test."""

import os


# Before JAX starts: one device, no accelerator probing.
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import pytest


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


@pytest.fixture
def getkey(request):
    """Fresh JAX random keys from a seed fixed by the test's name, so that a failure repeats."""
    state = [jax.random.PRNGKey(sum(request.node.name.encode()))]

    def _getkey():
        state[0], key = jax.random.split(state[0])
        return key

    return _getkey
