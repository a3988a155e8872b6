"""Programs that run for longer than they compile: LLVM's optimiser, which tests leave out of all others, is for them.

A diagnosis calls its filter hundreds of times on thousands of rows: optimised, it takes 0.1 s more to compile and runs
four times as fast. The first of LLVM's levels gives as much as the third.
"""

import functools

import jax


NAMES = ("inertiax.diagnose.noise.many_variances._whitened",)
OPTIONS = {"xla_backend_optimization_level": 1}


def install() -> None:
    """Take the place of `jax.jit`; call it before the package is imported."""
    plain = jax.jit

    @functools.wraps(plain)
    def jit(fun=None, **options):
        if fun is None:
            return functools.partial(jit, **options)
        name = f"{getattr(fun, '__module__', '')}.{getattr(fun, '__qualname__', '')}"
        if name in NAMES:
            options = {"compiler_options": OPTIONS} | options
        return plain(fun, **options)

    jax.jit = jit
