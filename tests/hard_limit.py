"""Run Python in its own process with a hard time limit, so that a hang is a failure."""

import subprocess
import sys


PREAMBLE = """
import jax
jax.config.update("jax_enable_x64", True)
import equinox as eqx
import jax.numpy as jnp
import numpy as np
"""


def run_limited(code: str, *, seconds: float) -> str:
    """Standard output of the code. Fails if it takes longer than `seconds` or exits non-zero."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", PREAMBLE + code],
            capture_output=True,
            text=True,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired as error:
        raise AssertionError(f"still running after {seconds} s: {error.stdout!r}") from error
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout
