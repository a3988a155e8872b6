"""A gyro triad made by hand with a named effect, and its protocol."""

import math

import numpy as np

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.physics.temperature import Constant, Curve
from inertiax.protocol.measurement import Measurement
from inertiax.protocol.protocol import make_protocol, Protocol
from inertiax.protocol.record import ConditionsRecord, Record, SCHEMA, StationRecord, TriadRecord
from inertiax.protocol.requirements import Limit
from inertiax.protocol.station import Station, StationTable


GRAVITY = 9.8
NAMES = tuple(
    [f"gyro.bias[{i}]" for i in range(3)]
    + [f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)]
)
VALUES = np.array([2e-3, -1e-3, 5e-4, 4e-3, 1e-4, 0, 0, -7e-3, 0, 0, 0, 6e-3])
SIGMAS = np.array([1e-5] * 3 + [3e-5] * 9)
COEFFICIENT, SIGMA = 8.871e-4, 5.86e-6  # rad/s/g²
ORDER = StationTable(order="2026-11")
STATION = StationRecord(GRAVITY, None, 1e-4, None, 0.1)
RECORD = Record(
    SCHEMA, "2026-01-31T12:00:00Z", "inertiax diagnose", {"inertiax": "0"}, "0" * 64, (), STATION,
    ConditionsRecord(1, 1000, 10.0, 1, (20.0, 20.0)), "gauss-newton", "good", (), (), (), (),
    None, TriadRecord(40, 0, 1e-5, 0.0, "rad/s", 100, ()),
)  # fmt: skip


def effect(name: str = "g2_sensitivity", **changes) -> FittedEffect:
    said = {
        "triad": "gyro", "channels": (1,), "settings": (("terms", "yy"),), "coefficients": np.array([COEFFICIENT]),
        "covariance": np.array([[SIGMA**2]]), "unit": "rad/s/g^2",
    } | changes  # fmt: skip
    return FittedEffect(name, **said)


def protocol(
    device: str = "SN7",
    station: StationTable = ORDER,
    effects: tuple[FittedEffect, ...] | None = None,
    record: Record = RECORD,
    limits: tuple[Limit, ...] = (
        Limit("gyro.bias", math.radians(0.05), "0.05 deg/s"),
        Limit("gyro.scale", 5e-3, "5000 ppm"),
    ),
) -> Protocol:
    return make_protocol(measured(device, effects, record), Station(station), limits)


def measured(
    device: str, effects: tuple[FittedEffect, ...] | None = None, record: Record = RECORD
) -> Measurement:
    """The triad's results; with the effect unless others are given."""
    triad = TriadCalibration(
        Curve(Constant(), VALUES[None]), np.diag(SIGMAS**2), NAMES, "reference"
    )
    calibration = Calibration(
        gravity=GRAVITY, accel=None, gyro=triad, device=device, temperature_range=(20.0, 20.0),
        effects=(effect(),) if effects is None else effects,
    )  # fmt: skip
    return Measurement(calibration, record)
