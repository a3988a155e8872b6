"""What the Earth's rate in a heading that no reference tells does to the gyros' blocks (`reduction.earth_at_rest`)."""

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ...reduction.earth_at_rest import untold_heading_covariance
from .blocks import Blocks


def heading_errors(blocks: Blocks, step: float) -> Float[np.ndarray, "block 3 3"]:
    """`untold_heading_covariance` of blocks, (rad/s)²; zero without references of both triads, and of moves, which turn
    often; `step`, s, is between samples."""
    if blocks.reference_accel is None or blocks.reference_gyro is None:
        return np.zeros((blocks.num_blocks, 3, 3))
    made = untold_heading_covariance(
        blocks.position, blocks.reference_gyro, blocks.reference_accel, step * blocks.count
    )
    return np.where(blocks.move[:, None, None], 0.0, made)


def with_heading_errors(blocks: Blocks, step: float) -> Blocks:
    """The blocks with what an unknown heading gives to plateaus, where it turns in the case, in the gyros' white
    variance."""
    turning = np.where(blocks.moving[:, None, None], heading_errors(blocks, step), 0.0)
    if blocks.gyro_white is None or not turning.any():
        return blocks
    return eqx.tree_at(
        lambda b: b.gyro_white, blocks, blocks.gyro_white + np.diagonal(turning, axis1=1, axis2=2)
    )
