"""Hard time limits, so that a hang is a failure: on Python in a process of its own, and on code in this one."""

import contextlib
import io
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import jax


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


@contextmanager
def ends_within(seconds: float) -> Iterator[None]:
    """Fail where the block is still at work after `seconds`; without limit where the system has no alarm (Windows)."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def end(number, frame):
        raise AssertionError(f"still running after {seconds} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_here(code: str, *, seconds: float, wide: bool = True) -> str:
    """Standard output of the code, as if pasted into an interpreter of JAX's defaults, 64 bits where `wide`.

    For code that needs no process of its own: it shares what is imported and compiled with the other tests.
    """
    said, before = io.StringIO(), jax.config.jax_enable_x64
    try:
        with (
            jax.enable_x64(wide),
            jax.numpy_rank_promotion("allow"),
            jax.numpy_dtype_promotion("standard"),
            contextlib.redirect_stdout(said),
            ends_within(seconds),
        ):
            exec(compile(code, "<code>", "exec"), {"__name__": "__main__"})
    finally:
        # What the code sets is set for all; read within `enable_x64` it would be what is set there.
        jax.config.update("jax_enable_x64", before)
    return said.getvalue()
