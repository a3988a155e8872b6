"""Calibrations as arguments of programs that `jax.export` writes to a file."""

import dataclasses
import functools
import json
from typing import Any

import equinox as eqx
import jax

from ..physics.temperature import Constant, CubicSpline, Curve, Polynomial
from .fitted_effects import FittedEffect
from .labels import Labels, Settings
from .pytree import Calibration
from .triad import TriadCalibration


@functools.cache
def register() -> None:
    """Let `jax.export` serialise programs that take or return a `Calibration`, its curves or its effects.

    To be called before `Exported.serialize` and `jax.export.deserialize`; again does nothing.
    """
    from jax import export

    # The labels are nobody's in a program.
    none = {"device": "", "notes": ()}
    export.register_pytree_node_serialization(
        Calibration,
        serialized_name="inertiax.Calibration",
        serialize_auxdata=lambda auxiliary: b"",
        deserialize_auxdata=lambda stored: ((), Labels(none)),
    )
    export.register_pytree_node_serialization(
        Settings,
        serialized_name="inertiax.Settings",
        serialize_auxdata=lambda fixed: json.dumps(fixed).encode(),
        deserialize_auxdata=lambda stored: tuple((k, v) for k, v in json.loads(stored)),
    )
    for cls in (TriadCalibration, Curve, Constant, Polynomial, CubicSpline, FittedEffect):
        export.register_pytree_node_serialization(
            cls,
            serialized_name=f"inertiax.{cls.__name__}",
            serialize_auxdata=functools.partial(_structure, cls),
            deserialize_auxdata=functools.partial(_auxiliary, cls),
        )


def _static(cls: type[eqx.Module]) -> list[str]:
    return [f.name for f in dataclasses.fields(cls) if f.metadata.get("static")]


def _structure(cls: type[eqx.Module], auxiliary: tuple) -> bytes:
    """A module's static fields, which end its structure in their order, as JSON."""
    names = _static(cls)
    return json.dumps(dict(zip(names, auxiliary[len(auxiliary) - len(names) :]))).encode()


def _auxiliary(cls: type[eqx.Module], stored: bytes) -> Any:
    """A module's structure, as JAX has it, from its static fields."""
    static = {k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(stored).items()}
    module = object.__new__(cls)
    for field in dataclasses.fields(cls):
        object.__setattr__(module, field.name, static.get(field.name))
    flattened = jax.tree_util.default_registry.flatten_one_level(module)
    assert flattened is not None  # a module is a node
    return flattened[1]
