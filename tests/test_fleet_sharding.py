"""The batched solves spread over several devices of JAX; in a process that is told to have four."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from jax.sharding import Mesh

from hard_limit import run_here, run_limited


FOUR_DEVICES = """
import os
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=4"
import json, sys
sys.path.insert(0, {tests!r})
from fleet_data import dwell_means, GRAVITY, HIGH, LOW, parameters
from inertiax.fleet import fit_invariant, fit_sharded, fit_thermal_invariant
from inertiax.physics.temperature import Constant, Polynomial

assert len(jax.devices()) == 4
rng = np.random.default_rng(0)
answer = {{}}
for degree in (0, 1):
    made = [dwell_means(rng, parameters(rng, degree), 2) for _ in range(30)]  # not a multiple of four
    outputs = np.stack([m[0] for m in made])
    outputs += rng.normal(0, 1e-4, outputs.shape)
    temperature = np.stack([m[1] for m in made])
    weights = np.full(temperature.shape, 1e4)
    basis = Constant() if degree == 0 else Polynomial(degree, LOW, HIGH)
    spread = fit_sharded(outputs, temperature, weights, GRAVITY, basis)
    # Filled up by hand, so that both are traced once.
    outputs, temperature, weights = (np.concatenate([x, x[-1:], x[-1:]]) for x in (outputs, temperature, weights))
    if degree == 0:
        alone = jax.jit(fit_invariant)(outputs.transpose(2, 1, 0), weights.T, jnp.asarray(GRAVITY))
    else:
        alone = jax.jit(fit_thermal_invariant)(outputs, temperature, weights, jnp.asarray(GRAVITY), basis)
    alone = jax.tree.map(lambda x: x[:30], alone)
    assert bool(spread.converged.all()) and spread.parameters.shape == alone.parameters.shape
    sigma = np.sqrt(np.diagonal(alone.covariance, axis1=1, axis2=2))
    error = np.abs(np.asarray(spread.parameters) - np.asarray(alone.parameters)) / sigma
    answer[str(degree)] = [float(error.max()), len(spread.covariance.sharding.device_set)]
print(json.dumps(answer))
"""


@pytest.mark.slow
def test_answers_do_not_depend_on_how_many_accelerators_share_the_work():
    found = json.loads(
        run_limited(FOUR_DEVICES.format(tests=str(Path(__file__).parent)), seconds=300.0)
    )
    for error, devices in found.values():
        # The shared metric of the thermal problem is a sum in another order; steps end below 1e-6 sigma.
        assert error < 1e-5
        assert devices == 4


def test_a_mesh_of_two_axes_is_refused():
    import jax

    from inertiax.fleet import fit_sharded
    from inertiax.physics.temperature import Constant

    mesh = Mesh(np.array(jax.devices()[:1]).reshape(1, 1), ("a", "b"))
    rows = np.ones((1, 12))
    with pytest.raises(ValueError, match="it must have one, over which"):
        fit_sharded(np.ones((1, 12, 3)), rows, rows, 9.8, Constant(), mesh=mesh)


@pytest.mark.slow
def test_the_benchmark_of_accelerators_runs_through_on_the_processor(tmp_path, monkeypatch):
    """Its form only: equal answers, and every figure there."""
    script = Path(__file__).parent.parent / "benchmarks" / "fleet" / "solve.py"
    monkeypatch.syspath_prepend(script.parent)
    monkeypatch.setattr(
        sys, "argv", [str(script), "--check-form", "--json", str(tmp_path / "table.json")]
    )
    run_here(f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')", seconds=240)
    table = json.loads((tmp_path / "table.json").read_text())
    for name in ("constant", "thermal"):
        assert table[name]["seconds"] > 0
        # The same processor, in batches of other sizes.
        assert table[name]["difference"] < 1e-9
