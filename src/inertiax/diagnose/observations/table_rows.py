"""What a table does to rows: errors within its stated level and right angle are taken away, for they are no physics
that a model lacks; those of axes that stand are part of the rows' noise (`noise.positioning_errors`)."""

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ...data.recording import Rig
from ...reduction.standing_axes import standing_errors, StandingErrors
from ...reduction.table_errors import table_errors
from .blocks import Blocks, Log
from .model_rows import Baseline


def without_table_errors(
    base: Baseline, blocks: Blocks, log: Log, rig: Rig, sizes: Float[np.ndarray, "3"] | None
) -> Baseline:
    """The rows less the table's errors of these sizes, in stated standard deviations (`calibrate.table_error_sizes`).

    An error of the reference acts on an output as on the reference: that of the matrix E + Γ is a thousandth of it.
    """
    if sizes is None or not np.any(sizes) or not base.form.by_reference:
        return base
    if blocks.reference_accel is None or blocks.reference_gyro is None:
        return base
    found = table_errors(
        blocks.position, blocks.reference_accel, blocks.reference_gyro, rig,
        run=log.recording[blocks.start],
    )  # fmt: skip
    added = getattr(found, base.form.triad) @ sizes
    less = tuple(y - added[:, c] for c, y in enumerate(base.observed))
    return eqx.tree_at(lambda b: b.observed, base, less)


def standing_of_blocks(blocks: Blocks, log: Log, rig: Rig) -> StandingErrors | None:
    """Errors of axes that stand, at blocks; `None` where none does so through several positions."""
    if blocks.reference_accel is None or blocks.reference_gyro is None:
        return None
    return standing_errors(
        blocks.position, blocks.reference_accel, blocks.reference_gyro, rig,
        run=log.recording[blocks.start],
    )  # fmt: skip
