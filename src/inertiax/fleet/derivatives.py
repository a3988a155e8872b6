"""How a fit depends on rig, reference and data: its derivatives, one device or many at once."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..analysis.error_budget import check_sources, source_derivatives
from ..analysis.sources import NAMES, Source
from ..calibration.calibration import Calibration
from ..physics.leaves import is_traced, own_object
from ..physics.temperature import Curve
from ..reduction.dwells import Dwells
from .fit import Fit


class Derivatives(eqx.Module):
    """Derivative of all coefficients by each source; leading axes are devices.

    `by_source[k]` has shape (…, coefficients, draws), in SI per standard deviation of the source `sources[k]`.
    """

    # SI per standard deviation of the source.
    by_source: tuple[Float[AnyArray, "*devices coefficients _"], ...]
    sources: tuple[str, ...] = eqx.field(static=True)  # names
    names: tuple[str, ...] = eqx.field(static=True)  # of the coefficients
    units: tuple[str, ...] = eqx.field(static=True)  # SI, of the coefficients

    @property
    def sigma(self) -> Float[AnyArray, "*devices sources coefficients"]:
        """1 sigma of every coefficient from each source."""
        xp = np if all(isinstance(d, np.ndarray) for d in self.by_source) else jnp
        each = [xp.sqrt(xp.sum(xp.square(d), axis=-1)) for d in self.by_source]
        return xp.stack(each, axis=-2)

    def covariance(self, source: str) -> Float[AnyArray, "*devices coefficients coefficients"]:
        """Covariance of the coefficients from one source, by its name or that of the function that made it:
        `"probe, each dwell"` or `"probe_noise"`.

        Raises `ValueError` for another.
        """
        name = NAMES.get(source, source)
        if name not in self.sources:
            raise ValueError(
                f"`table.covariance({source!r})`: there are {', '.join(map(repr, self.sources))}."
            )
        d = self.by_source[self.sources.index(name)]
        return d @ d.swapaxes(-1, -2)


def derivatives(fit: Fit, sources: Source | Sequence[Source]) -> Derivatives:
    """How the answer of `fit` moves with what went into it, to first order (`analysis.error_budget`).

    **Arguments:** one or several `sources` of `analysis.sources`, such as `gravity(1e-4)`, `positioning(1e-5)`,
    `output_noise()`. A source that does not touch a triad has derivatives of zero there. Pure: `jax.vmap` it over a
    fit's devices, or give the whole fit. Outside traced code in 64 bits whatever JAX is set to; inside, in JAX's
    precision, where 32 bits give about three digits.

    Raises `ValueError` for a source that touches nothing that the dwells hold, or no sources.
    """
    sources = [sources] if isinstance(sources, Source) else list(sources)
    if not sources:
        raise ValueError("`derivatives(fit, sources)`: no sources; give at least one.")
    for source in sources:
        if not isinstance(source, Source):
            raise ValueError(
                f"`derivatives(fit, sources)`: {source!r} is no source; give those of `ix.sources`, such as "
                f"`gravity(1e-4)`."
            )
    if is_traced(fit.succeeded):
        return _derivatives(fit, tuple(sources))
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _many(*jax.tree.map(own_object, (fit, tuple(sources)))))


@eqx.filter_jit
def _many(fit: Fit, sources: tuple[Source, ...]) -> Derivatives:
    one = lambda f: _derivatives(f, sources)
    for _ in range(np.ndim(fit.succeeded)):
        one = jax.vmap(one)
    return one(fit)


def _derivatives(fit: Fit, sources: tuple[Source, ...]) -> Derivatives:
    calibration: Calibration = fit.calibration
    dwells, parts, touched = fit.dwells, [], set()
    for name in ("accel", "gyro"):
        estimator, triad = getattr(fit, name), getattr(calibration, name)
        if estimator is None:
            continue
        mine = [s for s in sources if _touches(s, estimator, triad.curve, dwells)]
        touched |= {s.name for s in mine}
        found = dict(
            zip((id(s) for s in mine), source_derivatives(estimator, triad.curve, dwells, mine))
        )
        parts.append((jnp.size(triad.curve.coefficients), found))
        if name == "accel":
            dwells = _with_force(calibration, dwells)
    idle = [s.name for s in sources if s.name not in touched]
    if idle:
        raise ValueError(
            f"`derivatives(fit, sources)`: the source '{idle[0]}' changes nothing that these dwells hold; leave it out."
        )
    whole = tuple(_joined(parts, id(s)) for s in sources)
    return Derivatives(
        whole,
        tuple(s.name for s in sources),
        calibration.coefficient_names,
        calibration.coefficient_units,
    )


def _touches(source: Source, estimator: Any, curve: Curve, dwells: Dwells) -> bool:
    """Whether a source acts on what a triad's estimator reads."""
    try:
        check_sources(estimator, curve, dwells, [source])
    except (ValueError, AssertionError):
        return False
    return True


def _with_force(calibration: Calibration, dwells: Dwells) -> Dwells:
    """Dwells with compensated accelerometer outputs, as the gyros' estimator had them."""
    one = lambda a, t: calibration.without_effects()(a, jnp.zeros_like(a), t)[0]
    force = jax.vmap(one)(jnp.asarray(dwells.accel), jnp.asarray(dwells.temperature))
    # Computed once: a compiler would compensate anew for each of the derivatives that read it.
    force = jax.lax.optimization_barrier(force)
    return eqx.tree_at(lambda d: d.accel, dwells, force)


def _joined(parts: list[tuple[int, dict[int, Array]]], source: int) -> Array:
    width = next(found[source].shape[1] for _, found in parts if source in found)
    return jnp.concatenate(
        [found[source] if source in found else jnp.zeros((size, width)) for size, found in parts]
    )
