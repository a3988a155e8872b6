"""What writing a calibration in another tool's format gives: the files, and what they leave out."""

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np
from jaxtyping import Float


# (accelerometer outputs, gyro outputs, temperatures) to (specific force, angular rate), one row a
# sample: what the tool will compute, by its own formula, from the numbers in its file.
Applied = Callable[
    [Float[np.ndarray, "sample 3"], Float[np.ndarray, "sample 3"], Float[np.ndarray, " sample"]],
    tuple[Float[np.ndarray, "sample 3"], Float[np.ndarray, "sample 3"]],
]

# (magnetometer outputs, T; temperatures; currents, A) to the field, T, one row a sample.
AppliedField = Callable[
    [Float[np.ndarray, "sample 3"], Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]],
    Float[np.ndarray, "sample 3"],
]


class Export(NamedTuple):
    """Files of one format, and what is to be known about them."""

    # (tag put before the suffix, content); "" for the only one
    files: tuple[tuple[str, bytes], ...]
    applied: Applied
    losses: tuple[str, ...] = ()  # what the calibration says and the files do not
    notes: tuple[str, ...] = ()  # what the user still has to do or to know
    frame: Float[np.ndarray, "3 3"] = np.eye(3)  # from the case frame to the tool's output frame
    applied_field: AppliedField | None = None  # None: no magnetometers in the files

    @property
    def content(self) -> bytes:
        """The only file. Raises `ValueError` where there are several."""
        if len(self.files) != 1:
            raise ValueError(f"`Export.content`: there are {len(self.files)} files.")
        return self.files[0][1]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a format needs beyond the calibration; each format has its own fields."""


class OneTemperature(Settings, frozen=True, kw_only=True):
    """Settings of a format whose parameters are constants."""

    temperature: float | None = None  # °C at which the parameters are taken; None: mid-range


def frame_note(frame: Float[np.ndarray, "3 3"]) -> tuple[str, ...]:
    """How the tool's output axes lie in the case, in words; nothing where they are the same."""
    antisymmetric = np.array(
        [frame[2, 1] - frame[1, 2], frame[0, 2] - frame[2, 0], frame[1, 0] - frame[0, 1]]
    )
    angle = math.atan2(0.5 * float(np.linalg.norm(antisymmetric)), 0.5 * (np.trace(frame) - 1.0))
    if angle < 1e-12:
        return ()
    rows = "; ".join(", ".join(f"{x:.9f}" for x in row) for row in frame)
    return (
        f"output axes are the accelerometers' own, turned by {1e3 * angle:.4g} mrad from the case: "
        f"v_tool = [{rows}] v_case",
    )
