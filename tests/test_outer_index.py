"""An index error of a table's outer axis, by SciPy's rotations, beside a pier's tilt that looks the same."""

import numpy as np
from scipy.spatial.transform import Rotation

from inertiax.effects import CATALOGUE, Signal


AXIS, TILT = (next(e for e in CATALOGUE if e.name == n) for n in ("table_axis_error", "pier_tilt"))
ERROR = 1e-4  # rad


def test_an_index_error_of_the_outer_axis_is_a_form_and_a_tilt_about_it_is_the_same():
    angles = np.deg2rad(
        [[o, i] for o in (0.0, 45.0, 90.0, 180.0, -60.0) for i in (0.0, 90.0, 200.0)]
    )
    about = lambda axis, angle: Rotation.from_rotvec(angle[:, None] * np.eye(3)[axis])
    device = lambda more: (about(0, angles[:, 0] + more) * about(2, angles[:, 1])).inv()
    force = device(0.0).apply([0.0, 0.0, 1.0])
    zero = np.zeros(len(force))
    room = device(0.0).as_matrix()  # columns: the room's axes seen by the device
    signal = Signal(
        triad="accel", time=np.arange(len(force)) * 1.0, input=force, output=force, since_power=zero,
        since_start=zero, since_move=zero, move=0.0 * force, at_rest=zero == 0.0, force=force,
        rate=0.1 * room[:, :, 0], room=room, upright=True,
    )  # fmt: skip
    (variant,) = [v for v in AXIS.variants(signal) if v.label == "index of the outer axis"]
    # Its direction has either sign: that of an eigenvector.
    made = np.asarray(AXIS.shape(signal, **variant.settings))[:, :, 0]
    turned = (device(ERROR).apply([0.0, 0.0, 1.0]) - force) / ERROR
    side = np.sign(np.sum(made * turned))
    # m/s² for the input's g; what is left is of second order.
    np.testing.assert_allclose(side * made / 9.80665, turned, atol=ERROR)
    tilt = np.asarray(TILT.shape(signal, course="constant"))[:, :, 0]
    np.testing.assert_allclose(np.abs(tilt), np.abs(made), atol=1e-12)
    # Rates inside the outer axis know nothing of its index.
    gyros = Signal(**{**vars(signal), "triad": "gyro"})
    assert not [v for v in AXIS.variants(gyros) if v.label == "index of the outer axis"]
