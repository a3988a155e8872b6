"""A fixed-point iteration, for optimistix, that keeps every iterate and stops by the step in standard deviations."""

from collections.abc import Callable

from jaxtyping import Float, Int

from .._jax import Array, jnp, optx
from .._records import field, Module


class _RecordState(Module):
    index: Int[Array, ""]
    step_size: Float[Array, ""]
    history: Float[Array, "iterations unknowns"]
    step_sizes: Float[Array, " iterations"]


class RecordedIteration(optx.AbstractFixedPointSolver):
    """Plain fixed-point iteration that keeps every iterate and tests the step in sigmas, the third of `args`."""

    atol: float = field(static=True)  # standard deviations
    max_iterations: int = field(static=True)
    rtol: float = field(static=True, default=0.0)
    norm: Callable = field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> _RecordState:
        del fn, args, options, f_struct, aux_struct, tags
        history = jnp.full((self.max_iterations + 1, *y.shape), jnp.nan, y.dtype)
        return _RecordState(
            index=jnp.array(0),
            step_size=jnp.array(jnp.inf, y.dtype),
            history=history.at[0].set(y),
            step_sizes=jnp.full(self.max_iterations + 1, jnp.nan, y.dtype),
        )

    def step(self, fn, y, args, options, state, tags):
        del options, tags
        new, aux = fn(y, args)
        step_size = self.norm((new - y) / args[2])
        index = state.index + 1
        return (
            new,
            _RecordState(
                index,
                step_size,
                state.history.at[index].set(new),
                state.step_sizes.at[index].set(step_size),
            ),
            aux,
        )

    def terminate(self, fn, y, args, options, state, tags):
        del fn, y, args, options, tags
        return state.step_size < self.atol, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        del fn, args, options, tags, result
        return y, aux, {"history": state.history, "step_sizes": state.step_sizes}
