"""One triad's error parameters as curves over temperature."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field, Module
from .._typing import AnyArray, Scalar
from ..physics.parameter_names import parse
from ..physics.shapes import check_covariance
from ..physics.temperature import Curve


def is_parameter(name: str) -> bool:
    """Whether a name is that of a triad's parameter, such as `accel.matrix[1,0]`."""
    return parse(name) is not None


def slot(name: str) -> int:
    """Place of a named parameter in (bias 3, matrix 9, g-sensitivity 9 or current 3).

    Raises `ValueError` for another name.
    """
    parts = parse(name)
    if parts is None:
        raise ValueError(
            f"parameter name {name!r} is not one of accel|gyro|mag . bias[i], matrix[i,j], gyro.g_sensitivity[i,j], "
            f"mag.current[i] with i, j = 0, 1, 2."
        )
    if parts.kind == "bias":
        return parts.row
    if parts.kind == "current":
        return 12 + parts.row
    return {"matrix": 3, "g_sensitivity": 12}[parts.kind] + 3 * parts.row + parts.column


def unit_of(name: str) -> str:
    """SI unit of a parameter, as `calibration.json` writes it."""
    if ".matrix" in name:
        return "1"
    if name.startswith("accel"):
        return "m/s^2"
    if name.startswith("mag"):
        return "T/A" if ".current" in name else "T"
    return "rad/s/g" if "g_sensitivity" in name else "rad/s"


def refuse_stacked(
    triads: "Sequence[TriadCalibration]",
    call: str,
    cure: str = "take one by `ix.unstack(calibration)[k]`",
) -> None:
    """Raise `ValueError` for stacked devices."""
    shapes = [jnp.shape(t.curve.coefficients)[:-2] for t in triads]
    if any(shapes):
        raise ValueError(f"`{call}`: {shapes[0]} devices are stacked; {cure}.")


def twice(names: Sequence[str]) -> str | None:
    """The first name that stood before; `None` where each stands once."""
    return next((n for k, n in enumerate(names) if n in names[:k]), None)


MAPPED = "`jax.vmap` over them, or take one by `ix.unstack(calibration)[k]`"


def _on_host(values: object) -> bool:
    return isinstance(values, np.ndarray)


class TriadCalibration(Module):
    """One triad's error parameters as curves over temperature, with their covariance.

    Raises `ValueError` for a name that is no parameter's or stands twice, a matrix that is no covariance, or sizes that
    do not fit each other.
    """

    curve: Curve  # parameters over temperature, SI
    # Of the coefficients, row-major (size, parameters).
    covariance: Float[AnyArray, "*batch unknowns unknowns"]
    names: tuple[str, ...] = field(static=True)  # of the curve's columns
    estimator: str = field(static=True)  # how it was estimated: invariant, reference, ...
    # m/s², the outputs that an accelerometer bias counts from; None: from a reference or from zero.
    mean_output: Float[AnyArray, "*batch 3"] | None = None

    def __check_init__(self):
        for name in self.names:
            slot(name)
        again = twice(self.names)
        if again is not None:
            raise ValueError(f"`TriadCalibration(names=...)`: {again!r} stands twice.")
        coefficients = jnp.shape(self.curve.coefficients)
        if coefficients[-1] != len(self.names):
            raise ValueError(
                f"`TriadCalibration(names=...)`: {len(self.names)} names, but the curve has "
                f"{coefficients[-1]} parameters."
            )
        unknowns = coefficients[-1] * coefficients[-2]
        if jnp.shape(self.covariance)[-2:] != (unknowns, unknowns):
            raise ValueError(
                f"`TriadCalibration(covariance=...)`: shape {jnp.shape(self.covariance)}, but the curve's "
                f"{unknowns} coefficients need ({unknowns}, {unknowns})."
            )
        if _on_host(self.covariance):
            check_covariance("TriadCalibration(covariance=...)", self.covariance)

    def parameters(self, temperature: Scalar | float) -> Float[Array, "21"]:
        """Bias (3), matrix (9) and g-sensitivity (9) at one temperature, °C; zero where not fitted.

        Of magnetometers the field of a current (3) stands in the place of the g-sensitivity. Raises `ValueError` for
        stacked devices.
        """
        refuse_stacked((self,), "triad.parameters(temperature)", MAPPED)
        values = self.curve(temperature)
        place = {slot(n): k for k, n in enumerate(self.names)}
        # Runs of neighbours, neither gathered nor written to their slots, which is slow for many devices. Zeros come
        # from padding, so that under `vmap` they lie on the same accelerators as the others.
        zero, runs = jnp.pad(values, (0, 1))[-1], []
        for ahead, run in groupby(range(21), lambda k: k - place[k] if k in place else None):
            slots = list(run)
            own = slice(slots[0] - (ahead or 0), slots[-1] + 1 - (ahead or 0))
            runs.append(jnp.broadcast_to(zero, len(slots)) if ahead is None else values[own])
        return jnp.concatenate(runs)

    def standard_deviations(self, temperature: Scalar | float) -> Float[Array, " parameters"]:
        """1-sigma of the named parameters at one temperature: √diag(φ C φᵀ).

        Raises `ValueError` for stacked devices.
        """
        refuse_stacked((self,), "triad.standard_deviations(temperature)", MAPPED)
        phi = self.curve.basis(temperature)
        count = len(self.names)
        blocks = jnp.asarray(self.covariance).reshape(phi.size, count, phi.size, count)
        return jnp.sqrt(jnp.einsum("a,aibi,b->i", phi, blocks, phi))

    def over(
        self, temperatures: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n parameters"], Float[np.ndarray, "n parameters"]]:
        """The named parameters and their 1-sigma at many temperatures (°C), computed on the host.

        Raises `ValueError` for stacked devices.
        """
        refuse_stacked((self,), "triad.over(temperatures)")
        phi = self.curve.basis.rows(np.asarray(temperatures, float))
        size, count = phi.shape[1], len(self.names)
        blocks = np.asarray(self.covariance).reshape(size, count, size, count)
        variances = np.einsum("ta,aibi,tb->ti", phi, blocks, phi)
        return phi @ np.asarray(self.curve.coefficients), np.sqrt(variances)
