"""Vectors in arrays of NumPy, along the last axis: directions, cross products, angles.

For what runs on the host; `rotation` has rotations of one sample for what is compiled and differentiated.
"""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray


def unit_vector(vector: Float[AnyArray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """v / |v|; zero of a vector that is zero."""
    vector = np.asarray(vector)
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-300)


def cross_matrix(vector: Float[AnyArray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """[v]× with [v]× w = v × w."""
    vector = np.asarray(vector)
    result = np.zeros((*vector.shape, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    result[..., 0, 1], result[..., 0, 2], result[..., 1, 2] = -z, y, -x
    result[..., 1, 0], result[..., 2, 0], result[..., 2, 1] = z, -y, x
    return result


def axes_across(direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2 3"]:
    """Two unit vectors that are perpendicular to a unit vector and to each other."""
    axis = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    first = unit_vector(np.cross(direction, axis))
    return np.stack([first, np.cross(direction, first)], axis=-2)


def angle_between(
    one: Float[np.ndarray, "*#batch 3"], other: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*#batch"]:
    """Angle between directions, rad, from 0 to π: atan2(|a × b|, a·b), accurate for small angles as well."""
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(sine, np.sum(one * other, axis=-1)))
