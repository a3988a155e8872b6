"""Our own `calibration.json`, so that files of other tools can be brought in."""

import numpy as np

from .._jax import jax
from ..calibration.calibration import Calibration, read_calibration, write_calibration
from ..storage.whole_files import scratch_folder
from .export import Export, Settings as Common
from .parameters import parameters_over


NAME = "inertiax"
MAGNETOMETERS = True  # are held
BAROMETER = True
TITLE = "inertiax's calibration.json"
SUFFIX = ".json"
KEEPS = "everything"
LOSES = "nothing"

Settings = Common


def write(calibration: Calibration, settings: Common) -> Export:
    """The calibration as `write_calibration` writes it."""
    del settings
    with scratch_folder() as folder:
        write_calibration(calibration, folder / "calibration.json")
        content = (folder / "calibration.json").read_bytes()
        again = read_calibration(folder / "calibration.json")

    def applied(accel: np.ndarray, gyro: np.ndarray, temperature: np.ndarray):
        p = parameters_over(again, temperature)
        force = np.linalg.solve(p.accel_matrix, (accel - p.accel_bias)[:, :, None])[:, :, 0]
        left = gyro - p.gyro_bias - np.einsum("tij,tj->ti", p.gyro_by_force, force)
        return force, np.linalg.solve(p.gyro_matrix, left[:, :, None])[:, :, 0]

    mag = again.mag
    held = None if mag is None else lambda *samples: np.asarray(jax.vmap(mag)(*samples))
    return Export(files=(("", content),), applied=applied, applied_field=held)


def read(content: bytes) -> Calibration:
    """The calibration in a `calibration.json`."""
    with scratch_folder() as folder:
        path = folder / "calibration.json"
        path.write_bytes(content)
        return read_calibration(path)
