"""Which directions of the field a log of magnetometers lacks, and how to turn the device for them.

Turned all ways, the field's outputs span the same along every axis, twice its magnitude, but for some tenths of soft
iron. A cap of a sphere, or a band of it, spans less along one axis, and no ellipsoid is told by it.
"""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from ..physics.directions import nearest_by_hand, up_in_words


# Part of the widest span below which directions are missing: soft iron shortens an axis by some tenths, and a sphere
# without its caps of 48° has that. Convention.
_NARROW = 2.0 / 3.0
_TAIL = 0.01  # of the rows at either end, which single bad rows are


def narrowest(mag: Float[AnyArray, "row 3"]) -> tuple[Float[np.ndarray, "3"], float, float]:
    """The axis of the case along which the outputs span least, that span, and the widest one, T.

    Axes are those of the outputs' covariance.
    """
    outputs = np.asarray(mag)
    axes = np.linalg.eigh(np.cov(outputs.T))[1].T
    spans = np.ptp(np.quantile(outputs @ axes.T, (_TAIL, 1.0 - _TAIL), axis=0), axis=0)
    return axes[int(spans.argmin())], float(spans.min()), float(spans.max())


def how_to_turn(mag: Float[AnyArray, "row 3"]) -> str:
    """What to do for the directions along the narrowest axis, in words."""
    axis = narrowest(mag)[0]
    up = nearest_by_hand(axis * np.sign(axis[np.abs(axis).argmax()]))
    return (
        f"turn the device all ways: {up_in_words(up)}, {up_in_words(-up)}, and once round about the vertical in both, "
        "beside what was recorded"
    )


def missing_directions(mag: Float[AnyArray, "row 3"]) -> str | None:
    """What is missing, in words that follow a colon; `None` where the field was turned all ways.

    ```python
    import numpy as np
    from inertiax.calibrate.magnetic_directions import missing_directions

    rng = np.random.default_rng(0)
    turned = rng.normal(size=(500, 3))
    turned *= 48e-6 / np.linalg.norm(turned, axis=1)[:, None]
    print(missing_directions(turned))    # None
    print(missing_directions(turned[turned[:, 2] > 2e-5])[:44])    # along z the field moves by 28 µT only, besid
    ```
    """
    axis, least, most = narrowest(mag)
    if least > _NARROW * most:
        return None
    parts = nearest_by_hand(axis * np.sign(axis[np.abs(axis).argmax()]))
    signs = [f"{'+' if v > 0 else '−'}{c}" for c, v in zip("xyz", parts, strict=True) if v]
    along = signs[0][1] if len(signs) == 1 else f"the direction between {' and '.join(signs)}"
    return (
        f"along {along} the field moves by {_rounded(least)} µT only, beside {_rounded(most)} µT where it was turned "
        f"most, so that the ellipsoid is told badly; {how_to_turn(mag)}"
    )


def _rounded(tesla: float) -> str:
    return f"{float(f'{1e6 * tesla:.2g}'):g}"
