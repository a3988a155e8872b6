"""Diagnosis of any differentiable model: residuals, Jacobians and signatures from the user's own function.

`predict(parameters, signal)` gives the outputs that the user's model expects, `(time, 3)`. Its Jacobian
at the given parameters stands for what a refit could absorb; everything beyond is judged as usual.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray
from ..data.recording import Campaign
from ..effects import CATALOGUE, Effect, Signal
from ..numerics.compilation_cache import make_room
from .candidates.empirical import alternatives
from .candidates.repeated_inputs import repeated_levels
from .candidates.signatures import coarsen, terms
from .candidates.smooth import flexible
from .noise.observation_series import make
from .observations.blocks import Blocks, cut, join, Log
from .observations.model_rows import Baseline, ModelForm, of_means
from .observations.signals import build, specific_force
from .problem import Prepared


Parameters = TypeVar("Parameters")


def linearised(
    predict: Callable[[Parameters, Signal], Float[Array, "time 3"]],
    parameters: Parameters,
    signal: Signal,
    log: Log,
    blocks: Blocks,
    form: ModelForm,
) -> Baseline:
    """Residual outputs at the blocks and the model's Jacobian there, one chain per channel."""
    leaves, structure = jax.tree.flatten(eqx.filter(parameters, eqx.is_inexact_array_like))
    flat = np.concatenate([np.ravel(x) for x in leaves])
    shapes = [np.shape(x) for x in leaves]

    def outputs(vector: Float[AnyArray, " parameter"]) -> Float[Array, "time 3"]:
        cuts = np.cumsum([int(np.prod(s)) for s in shapes])[:-1]
        parts = [x.reshape(s) for x, s in zip(np.split(np.arange(len(flat)), cuts), shapes)]
        given = jax.tree.unflatten(structure, [vector[p] for p in parts])
        return predict(eqx.combine(given, parameters), signal)

    expected = np.asarray(outputs(flat), float)
    jacobian = np.asarray(jax.jacfwd(outputs)(flat), float)
    output = getattr(log, form.triad)
    residual = blocks.mean(output - expected)
    slope = blocks.mean(jacobian)
    observed, columns, index = [], [], []
    for c in range(3):
        felt = np.flatnonzero(np.abs(slope[:, c]).max(axis=0) > 0.0)
        x = slope[:, c][:, felt] if len(felt) else np.ones((len(residual), 1))
        observed.append(residual[:, c] - x @ np.linalg.lstsq(x, residual[:, c], rcond=1e-10)[0])
        columns.append(x)
        index.append(felt if len(felt) else np.array([0]))
    ones = tuple(np.ones((len(residual), 1)) for _ in range(3))
    given = blocks.mean(np.asarray(signal.input))
    return Baseline(form, flat[:, None], tuple(observed), tuple(columns), tuple(index), ones, given)


class AtTemperature(eqx.Module):
    """The user's model with another temperature in the signal."""

    predict: Callable = eqx.field(static=True)
    parameters: object  # those that can be fitted: numbers and arrays of them
    signal: Signal

    @classmethod
    def of(cls, predict: Callable, parameters: object, signal: Signal) -> "AtTemperature":
        """From a user's function: what of its parameters is no real number stays with the function."""
        fitted, other = eqx.partition(parameters, eqx.is_inexact_array_like)
        return cls(lambda p, s: predict(eqx.combine(p, other), s), fitted, signal)

    def __call__(self, temperature: Float[AnyArray, " time"]) -> Float[Array, "time 3"]:
        # Compiled, for it is asked for many times.
        return jax.jit(self.predict)(
            self.parameters, eqx.tree_at(lambda s: s.temperature, self.signal, temperature)
        )

    def with_parameters(
        self, base: Baseline, coefficients: Float[np.ndarray, "parameter 1"]
    ) -> "AtTemperature":
        """The same for other values of the flattened parameters."""
        from jax.flatten_util import ravel_pytree  # JAX by name, not by `_jax`

        given = ravel_pytree(self.parameters)[1](jnp.asarray(coefficients[:, 0]))
        return AtTemperature(self.predict, given, self.signal)


def prepare_model(
    predict: Callable[[Parameters, Signal], Float[Array, "time 3"]],
    parameters: Parameters,
    campaign: Campaign,
    catalogue: Sequence[Effect] = CATALOGUE,
    *,
    triad: str,
    inputs: Float[AnyArray, "time 3"] | None = None,
) -> Prepared:
    """Rows, candidates and noise structure of a user's model, ready for the search."""
    make_room()
    if (
        inputs is not None
    ):  # plateaus of constant rate, too, are found by what the triad went through
        campaign = replace(
            campaign,
            recordings=tuple(
                replace(r, **{f"reference_{triad}": inputs}) for r in campaign.recordings
            ),
        )
    log = join(campaign)
    if getattr(log, triad) is None:
        raise ValueError(
            f"`diagnose_model(triad={triad!r})`: the recording has no {triad} columns."
        )
    blocks = cut(log)
    blocks = blocks[~blocks.held]
    means = of_means(triad, blocks, campaign.site.gravity)
    form = means.form
    force = specific_force(log, blocks, None)
    signal = build(log, blocks, means, force)
    if inputs is not None:
        scale = campaign.site.gravity if triad == "accel" else 1.0
        signal = eqx.tree_at(lambda s: s.input, signal, np.asarray(inputs) / scale)
    base = linearised(predict, parameters, signal, log, blocks, form)
    if signal.temperature is not None:
        signal = eqx.tree_at(
            lambda s: s.at_temperature, signal, AtTemperature.of(predict, parameters, signal),
            is_leaf=lambda x: x is None,
        )  # fmt: skip
    coarse = coarsen(signal, blocks)
    listed, missing = terms(tuple(catalogue), signal, blocks, base)
    none = np.zeros(blocks.num_blocks)
    system = make(base, blocks, [none] * 3, [none[:, None][:, :0]] * 3)
    unlisted = alternatives(coarse, blocks, base)
    candidates = (*listed, *unlisted)
    free = (*flexible(coarse, base), *repeated_levels(coarse, blocks, base))
    return Prepared(form, blocks, signal, coarse, system, candidates, free, missing, log.clock)
