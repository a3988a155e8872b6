"""Residuals of the model before and after the named effects, with what they may depend on."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from .candidates.signatures import Term
from .problem import Prepared


TURN = "direction after a motion"


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


def residuals(prepared: Prepared, chosen: Sequence[Term]) -> Residuals:
    """Weighted least squares of the baseline, alone and beside the chosen terms."""
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
    )
