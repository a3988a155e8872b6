"""Residuals of the model before and after the named effects, with what they may depend on."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx
from .candidates.signatures import Term
from .noise.observation_series import NoiseFit
from .problem import Prepared
from .selection.score_test import whiten_system


TURN = "direction after a motion"


class FittedCourse(eqx.Module):
    """What a named effect adds to the rows by its fitted coefficients, block by block."""

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    values: Float[
        np.ndarray, "block row"
    ]  # in the unit of the residuals; 0 on rows that it leaves alone
    sigma: Float[np.ndarray, "block row"]  # 1 sigma by the coefficients' covariance


class Residuals(eqx.Module):
    """One triad's residuals block by block; columns that the campaign does not tell are `None`."""

    triad: str = eqx.field(static=True)
    # Of the rows; |accel| for the invariant, TURN for gravity's direction after motions.
    channels: tuple[str, ...] = eqx.field(static=True)
    time: Float[np.ndarray, " block"]  # s, on the recording's clock
    experiment: Int[np.ndarray, " block"]
    moving: Bool[np.ndarray, " block"]
    since_move: Float[np.ndarray, " block"]  # s
    input: Float[np.ndarray, "block 3"]  # g or rad/s
    temperature: Float[np.ndarray, " block"] | None  # °C
    temperature_rate: Float[np.ndarray, " block"] | None  # °C/s
    force: Float[np.ndarray, "block 3"] | None  # g
    rate: Float[np.ndarray, "block 3"] | None  # rad/s
    before: Float[np.ndarray, "block row"]  # m/s², rad/s or rad, of the model as meant
    after: Float[np.ndarray, "block row"]  # with the effects in the fit
    loads: Float[np.ndarray, "block 3"] | None = None  # of the outputs on a single row, |accel|
    position: Int[np.ndarray, " block"] | None = None  # −1 while it turns
    fitted: tuple[FittedCourse, ...] = ()  # of each named effect

    @property
    def name(self) -> str:
        """In names of files: the triad, and "motions" where the rows are of these."""
        return f"{self.triad}-motions" if self.channels == (TURN,) else self.triad

    @property
    def changed(self) -> bool:
        """Whether named effects take anything from these rows, beyond rounding."""
        size = np.abs(self.before).max(initial=0.0)
        return bool(np.abs(self.after - self.before).max(initial=0.0) > 1e-9 * size)

    def of(self, channel: str) -> int:
        """Column of the rows that a channel of the triad shows up in."""
        return self.channels.index(channel) if channel in self.channels else 0


def residuals(
    prepared: Prepared, chosen: Sequence[Term], noise: NoiseFit | None = None
) -> Residuals:
    """Weighted least squares of the baseline, alone and beside the chosen terms.

    With the `noise` that coefficients are stated with, `fitted` has the course of each effect of the catalogue.
    """
    system, blocks, coarse = prepared.system, prepared.blocks, prepared.coarse
    columns = [[], []]
    for c, chain in enumerate(system.chains):
        mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
        w, y = 1.0 / np.sqrt(chain.white), system.base.observed[c]
        for k, x in enumerate(
            (system.frames[c], np.concatenate([system.frames[c], *mine], axis=1))
        ):
            x = x / (np.linalg.norm(x, axis=0) + 1e-300)
            solution = np.linalg.lstsq(x * w[:, None], y * w, rcond=1e-9)[0]
            columns[k].append(y - x @ solution)
    triad = prepared.form.triad
    names = tuple(f"{triad}_{a}" for a in "xyz")
    alone = TURN if prepared.motions else f"|{triad}|"

    def plain(values):
        return None if values is None else np.asarray(values, float)

    return Residuals(
        triad=triad,
        channels=names if len(system.chains) == 3 else (alone,),
        time=prepared.clock[(blocks.start + blocks.stop) // 2],
        experiment=blocks.experiment,
        moving=blocks.moving,
        since_move=np.asarray(coarse.since_move, float),
        input=np.asarray(coarse.input, float),
        temperature=plain(coarse.temperature),
        temperature_rate=plain(coarse.temperature_rate),
        force=plain(coarse.force),
        rate=plain(coarse.rate),
        before=np.stack(columns[0], axis=1),
        after=np.stack(columns[1], axis=1),
        loads=None if len(system.chains) == 3 or prepared.motions else system.base.loads[0],
        position=blocks.position,
        fitted=() if noise is None else _fitted(prepared, chosen, noise),
    )


def _fitted(
    prepared: Prepared, chosen: Sequence[Term], noise: NoiseFit
) -> tuple[FittedCourse, ...]:
    """The courses of effects that have coefficients, by generalised least squares beside the others."""
    made = []
    for k, term in enumerate(chosen):
        others = [*chosen[:k], *chosen[k + 1 :]]
        found = whiten_system(prepared.system, noise, [term], others).scores
        if term.effect is None or not found:
            continue
        (score,) = found
        shape = (prepared.blocks.num_blocks, len(prepared.system.chains))
        values, sigma = np.zeros(shape), np.zeros(shape)
        for c, x in zip(term.chains, term.columns, strict=True):
            values[:, c] = x @ score.coefficients
            square = np.einsum("bi,ij,bj->b", x, score.covariance, x)
            sigma[:, c] = np.sqrt(np.maximum(square, 0.0))
        made.append(FittedCourse(term.name, term.channel_names, values, sigma))
    return tuple(made)
