"""The one least-squares entry under JAX.

Everything that is estimated inside a compiled program goes through `least_squares`: optimistix' Gauss-Newton (or, on
request, Levenberg-Marquardt) with a convergence test on parameters and residuals, a gradient through the solution by
the implicit function theorem, and an outcome per solve that never raises inside a batch. `gauss_newton` is the same
iteration driven from the host.
"""

from collections.abc import Callable
from typing import Any

from jaxtyping import Bool, Float, Int

from .._jax import Array, eqx, jax, jnp, optx, PyTree
from .._records import Module
from .._typing import AnyArray
from ..physics.leaves import is_traced
from .linear_algebra import spd_inverse


MAX_STEPS = 50  # of a solve, unless told


class Solution(Module):
    """Result of one least-squares solve; every field gains leading axes under `vmap`."""

    parameters: Float[AnyArray, "*batch parameters"]
    residuals: Float[AnyArray, "*batch rows"]  # whitened, at the solution
    covariance: Float[AnyArray, "*batch parameters parameters"]  # (JᵀJ)⁻¹; NaN where rank deficient
    result: "optx.RESULTS"  # outcome as data; `outcome` in words
    num_steps: Int[AnyArray, " *batch"]

    @property
    def succeeded(self) -> Bool[AnyArray, " *batch"]:
        """Whether the convergence test was met with finite numbers and a full-rank Jacobian."""
        regular = jnp.all(jnp.isfinite(jnp.diagonal(self.covariance, axis1=-2, axis2=-1)), axis=-1)
        return (self.result == optx.RESULTS.successful) & regular

    @property
    def outcome(self) -> str:
        """How one solve ended, in words. Raises `ValueError` for many or in traced code."""
        return outcome("solution.outcome", self.result, self.succeeded)


def outcome(call: str, result: "optx.RESULTS", succeeded: AnyArray | bool) -> str:
    """How a solve ended, in words."""
    if is_traced(succeeded) or jnp.ndim(succeeded):
        raise ValueError(
            f"`{call}`: it is of one known solve; `solution.succeeded` tells many and works in traced code."
        )
    if succeeded:
        return "converged"
    if bool(result == optx.RESULTS.successful):
        return "the data do not determine all parameters"
    return " ".join(optx.RESULTS[result].split())


def gauss_newton(*, tolerance: float = 1e-7) -> "optx.AbstractLeastSquaresSolver":
    """Gauss-Newton with the dense solver: quick where the start is good, as closed-form starts are.

    `tolerance` is in standard deviations: the last step of every parameter, in units of its own
    scale 1/‖J column‖, and the change of every whitened residual must be below it.
    """
    return optx.GaussNewton(
        rtol=1e-12, atol=tolerance, norm=optx.max_norm, linear_solver=_dense_normal()
    )


def _dense_normal() -> Any:
    from .dense_normal import (
        DenseNormal,  # made of a solver of lineax, for which the host need not wait
    )

    return DenseNormal()


def least_squares(
    residual: Callable[[Array, PyTree], Float[Array, " rows"]],
    start: Float[AnyArray, " parameters"],
    args: PyTree = None,
    *,
    solver: "optx.AbstractLeastSquaresSolver | None" = None,
    max_steps: int = MAX_STEPS,
) -> Solution:
    """Minimise ½ ‖r(p, args)‖² from `start`; never raises for numerical reasons.

    **Arguments:** `residual(p, args)` returns whitened residuals (unit variance where the noise
    model is right); `args` is a pytree of whatever the residual depends on, and derivatives of the
    solution with respect to it are exact: dp/dargs follows from the implicit function theorem with
    the full Hessian, also under `jit` and `vmap`.
    **Returns** a `Solution` whose `result` tells how it ended.

    Parameters are solved for in units of 1/‖J column‖ at the start, about one standard deviation
    each, so that one tolerance serves biases in m/s² and dimensionless scale factors alike.
    """
    parameters, inner = _minimise(residual, start, args, solver, max_steps)
    twice = lambda p: (residual(p, args),) * 2  # jacfwd gives the second back as it is
    jacobian, left = jax.jacfwd(twice, has_aux=True)(parameters)
    return Solution(
        parameters=parameters,
        residuals=left,
        covariance=spd_inverse(jacobian.T @ jacobian),
        result=inner.result,
        num_steps=inner.stats["num_steps"],
    )


def minimiser(
    residual: Callable[[Array, PyTree], Float[Array, " rows"]],
    start: Float[AnyArray, " parameters"],
    args: PyTree = None,
) -> Float[Array, " parameters"]:
    """The parameters of `least_squares` alone: nothing else is traced, which counts inside of an iteration."""
    return _minimise(residual, start, args, None, MAX_STEPS)[0]


def without_derivatives(tree: PyTree) -> PyTree:
    """The tree as a constant: what is made of it alone is not differentiated in vain."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


def _minimise(
    residual: Callable[[Array, PyTree], Float[Array, " rows"]],
    start: Float[AnyArray, " parameters"],
    args: PyTree,
    solver: "optx.AbstractLeastSquaresSolver | None",
    max_steps: int,
) -> tuple[Float[Array, " parameters"], Any]:
    start = jax.lax.stop_gradient(jnp.asarray(start))
    jacobian = jax.jacfwd(residual)(start, without_derivatives(args))
    squares = jnp.sum(jnp.square(jacobian), axis=0)
    scale = jax.lax.stop_gradient(
        jax.lax.rsqrt(jnp.where(squares > 0, squares, jnp.ones_like(squares)))
    )
    inner = optx.least_squares(
        lambda scaled, a: residual(a[0] * scaled, a[1]),
        gauss_newton() if solver is None else solver,
        start / scale,
        (scale, args),
        max_steps=max_steps,
        adjoint=optx.ImplicitAdjoint(linear_solver=_dense_normal()),
        throw=False,
    )
    return inner.value * scale, inner
