"""One program over several accelerators or hosts: the devices under calibration are split along a mesh axis.

Every device's numbers stay where they are; only whether all have settled, and the mean normal matrix that
starts the thermal problem, go between accelerators.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float

from ...physics.temperature import AbstractBasis, Constant
from .invariant import BatchFit, fit_invariant
from .thermal import fit_thermal_invariant


AXIS = "devices"


def fit_sharded(
    outputs: Float[np.ndarray, "devices dwells 3"],
    temperature: Float[np.ndarray, "devices dwells"],
    weights: Float[np.ndarray, "devices dwells"],
    gravity: float,
    basis: AbstractBasis,
    *,
    mesh: Mesh | None = None,
) -> BatchFit:
    """The invariant accelerometer problem of many devices on all accelerators of a mesh at once.

    **Arguments:** `outputs` in m/s², `temperature` in °C, `weights` 1/σ of each dwell in s²/m, zero for
    padding; `mesh` has one axis, default: all of JAX's devices.

    Returns the fits in the order given, spread over the mesh. Raises `ValueError` for a mesh of several axes.
    """
    mesh = Mesh(np.array(jax.devices()), (AXIS,)) if mesh is None else mesh
    if len(mesh.axis_names) != 1:
        raise ValueError(
            f"`fit_sharded(mesh=...)`: the mesh has axes {mesh.axis_names}; it must have one, over which "
            "the devices are split."
        )
    count, parts = len(outputs), mesh.size
    # Every accelerator takes as many; the last device is repeated to fill up.
    rows = np.minimum(np.arange(-(-count // parts) * parts), count - 1)
    (axis,) = mesh.axis_names
    if isinstance(basis, Constant):
        place = lambda x, *spec: jax.device_put(x, NamedSharding(mesh, PartitionSpec(*spec)))
        lanes = place(outputs[rows].transpose(2, 1, 0), None, None, axis)
        fit = _constant(lanes, place(weights[rows].T, None, axis), jnp.asarray(gravity))
    else:
        split = NamedSharding(mesh, PartitionSpec(axis))
        given = (jax.device_put(x[rows], split) for x in (outputs, temperature, weights))
        fit = _thermal(*given, jnp.asarray(gravity), basis)
    return jax.tree.map(lambda x: x[:count], fit)


_constant = jax.jit(fit_invariant)
_thermal = jax.jit(fit_thermal_invariant)
