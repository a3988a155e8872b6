"""Hints to the compiler change no result, and a step's estimate of what is left holds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.fleet.solve import batch
from inertiax.fleet.solve.invariant import fit_chunks, fit_invariant
from inertiax.numerics.own_kernels import is_tried, joined, kept, one_kernel


GRAVITY = 9.81


def _problem(
    dwells: int, lanes: int, noise: float, *, half: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (1, 3, dwells, lanes) in random attitudes, with errors of some per cent, and weights."""
    rng = np.random.default_rng(4)
    force = rng.normal(size=(lanes, dwells, 3))
    force[..., 2] = np.abs(force[..., 2]) if half else force[..., 2]
    force *= GRAVITY / np.linalg.norm(force, axis=-1, keepdims=True)
    matrix = np.eye(3) + np.tril(rng.normal(0, 0.02, (lanes, 3, 3)))
    a = np.einsum("lij,lnj->lni", matrix, force) + rng.normal(0, 0.1, (lanes, 1, 3))
    a += rng.normal(0, noise, a.shape)
    return a.transpose(2, 1, 0)[None].copy(), np.full((1, dwells, lanes), 1.0 / noise)


def test_a_kept_result_is_a_computation_of_its_own_unless_joined():
    square = kept(lambda x: x * x)
    x = jnp.arange(3.0)
    np.testing.assert_array_equal(square(x), [0.0, 1.0, 4.0])
    assert "inlineable" in jax.jit(lambda x: square(x) + 1.0).lower(x).as_text()
    with joined():
        assert "inlineable" not in jax.jit(lambda x: square(x) + 2.0).lower(x).as_text()
        np.testing.assert_array_equal(square(x), [0.0, 1.0, 4.0])
        whole = one_kernel(lambda x: x + 1.0)
        assert "small_call" not in jax.jit(lambda x: whole(x)).lower(x).as_text()


@pytest.mark.slow
@pytest.mark.skipif(
    not is_tried(), reason="one kernel is made of versions of jaxlib that it was tried with"
)
@pytest.mark.parametrize(("dwells", "dtype"), [(18, "float64"), (55, "float64"), (18, "float32")])
def test_chunks_in_one_kernel_are_those_in_many(dwells, dtype):
    a, w = _problem(dwells, 64, 1e-2)
    with jax.enable_x64(True):
        given = a.astype(dtype), w.astype(dtype), np.asarray(GRAVITY, dtype), np.int32(1)
        one, many = batch._whole(*given), jax.jit(fit_chunks)(*given)
        assert "small_call" in batch._whole.lower(*given).as_text()
    assert np.asarray(one.converged).all()
    sigma = np.sqrt(np.diagonal(many.covariance[0], axis1=1, axis2=2))
    rounding = 1e-9 if dtype == "float64" else 0.2  # of a sigma of 1e-3 of gravity
    assert (np.abs(one.parameters[0] - many.parameters[0]) / sigma).max() < rounding
    np.testing.assert_allclose(
        one.covariance, many.covariance, rtol=1e3 * np.finfo(dtype).eps, atol=1e-3
    )


def test_what_xla_makes_no_single_kernel_of_is_solved_all_the_same(monkeypatch):
    def refuse(*_):
        raise jax.errors.JaxRuntimeError("UNIMPLEMENTED: as XLA says it")

    monkeypatch.setattr(batch, "_whole", refuse)
    monkeypatch.setattr(batch, "is_tried", lambda: True)
    monkeypatch.setattr(batch, "_refused", set())
    a, w = _problem(18, 8, 1e-3)
    with jax.enable_x64(True):
        fit = batch.solve_chunks(a, w, np.asarray(GRAVITY), np.int32(1))
    assert np.asarray(fit.converged).all()
    assert batch._refused == {a.shape}


@pytest.mark.parametrize("half", [False, True])  # of the sphere: some coefficients are told badly
@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2, 0.1])
def test_steps_end_where_further_ones_move_less_than_told(noise, half):
    a, w = _problem(18, 64, noise, half=half)
    with jax.enable_x64(True):
        solve = jax.jit(fit_invariant, static_argnames=("tolerance", "max_steps"))
        fit = solve(a[0], w[0], jnp.asarray(GRAVITY))
        further = solve(a[0], w[0], jnp.asarray(GRAVITY), tolerance=1e-13, max_steps=60)
    done = np.asarray(fit.converged & np.isfinite(further.parameters).all(axis=1))
    assert done.sum() > (60 if noise < 0.1 else 10)
    sigma = np.sqrt(np.diagonal(further.covariance, axis1=1, axis2=2))
    off = np.abs(np.asarray(fit.parameters - further.parameters)) / sigma
    assert off[done].max() < 1e-6
    assert noise > 1e-4 or np.median(fit.num_steps) == 2  # the start and one step
