"""What rests and plateaus err by where no reference tells the heading of the case.

So it is on a table that turns about the vertical alone: the Earth's rate in that heading is part of the gyros' means
(`reduction.earth_at_rest`), and a lean of the base points another way in the case at each rest
(`reduction.rig_errors.leans_of_rests`).
"""

import numpy as np
from jaxtyping import Float, Int

from ..._jax import eqx
from ...data.recording import Rig
from ...reduction.earth_at_rest import heading_is_untold, untold_heading_covariance
from ...reduction.rig_errors import rig_covariance
from ...reduction.room_attitudes import turns_told
from ...reduction.table_errors import leans_of_part_turns
from .blocks import Blocks
from .model_rows import ModelForm


def errors_of_rests(
    blocks: Blocks, form: ModelForm, rig: Rig, step: float
) -> list[Float[np.ndarray, " block"]]:
    """Variance of what each rest has by itself, on each chain, SI; zero on plateaus, and where a heading is told.

    **Arguments:** `step`, s, is between samples.
    """
    force = blocks.reference_accel
    if not form.by_reference or force is None or blocks.reference_gyro is None:
        return [np.zeros(blocks.num_blocks)] * (1 if form.by_magnitude else 3)
    rate = blocks.reference_gyro
    if form.triad == "gyro":
        errors = _heading_errors(blocks, rate, force, step)
        square = np.where(blocks.moving[:, None, None], 0.0, errors)
    else:
        untold = heading_is_untold(blocks.position, rate, force)
        square = rig_covariance(force, (rig.level_uncertainty or 0.0) * untold)
    return [square[:, c, c] for c in range(3)]


def with_heading_errors(blocks: Blocks, step: float) -> Blocks:
    """The blocks with what an unknown heading gives to plateaus, where it turns in the case, in the gyros' white
    variance; `step`, s, is between samples."""
    rate, force, white = blocks.reference_gyro, blocks.reference_accel, blocks.gyro_white
    if white is None or rate is None or force is None:
        return blocks
    errors = _heading_errors(blocks, rate, force, step)
    turning = np.where(blocks.moving[:, None, None], errors, 0.0)
    if not turning.any():
        return blocks
    wider = white + np.diagonal(turning, axis1=1, axis2=2)
    return eqx.tree_at(lambda b: b.gyro_white, blocks, wider)


def with_leans_of_part_turns(
    blocks: Blocks, rig: Rig, step: float, recording: Int[np.ndarray, " block"]
) -> Blocks:
    """The blocks with `leans_of_part_turns` in the accelerometers' white variance; `step`, s, is between samples, and
    `recording` numbers each block's log."""
    rate, force, white = blocks.reference_gyro, blocks.reference_accel, blocks.accel_white
    if white is None or rate is None or force is None or not rig.level_uncertainty:
        return blocks
    position = np.where(blocks.moving, -1, 0)
    told = turns_told(position, force, rate, recording, rig.axes)
    own = leans_of_part_turns(position, force, rate, step * blocks.count, rig, told)
    wider = white + np.diagonal(own, axis1=1, axis2=2)
    return eqx.tree_at(lambda b: b.accel_white, blocks, wider)


def _heading_errors(
    blocks: Blocks,
    rate: Float[np.ndarray, "block 3"],
    force: Float[np.ndarray, "block 3"],
    step: float,
) -> Float[np.ndarray, "block 3 3"]:
    """`untold_heading_covariance` of blocks, (rad/s)²."""
    return untold_heading_covariance(blocks.position, rate, force, step * blocks.count, blocks.move)
