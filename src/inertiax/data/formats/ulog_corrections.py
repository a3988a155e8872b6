"""What PX4 did to the values of a log, by the parameters and the release that the log states.

`sensor_accel`, `sensor_gyro` and `sensor_mag` hold what the sensors gave since PX4 1.12, which corrects behind them;
before, each driver published (x − CAL_*OFF) · CAL_*SCALE. `sensor_combined` is behind all corrections, thermal ones
(TC_*) included, and turned into the vehicle's axes. Builds from between two releases state the one before and may do
either, so that nothing is taken away again.

**Reference:** PX4-Autopilot, `lib/drivers/accelerometer/PX4Accelerometer.cpp` of 1.11 and of later releases,
`lib/sensor_calibration/Accelerometer.hpp`.
"""

from collections.abc import Mapping, Set

from ..compensated import WRONG_PARAMETERS


_RAW_SINCE = (1, 12)
_SENSORS = ("ACC", "GYRO", "MAG")
_MOST_SENSORS = 4
_NEUTRAL = {"OFF": 0.0, "SCALE": 1.0}
_THERMAL = ("TC_A_ENABLE", "TC_G_ENABLE")


def doubt_about(
    topic: str, parameters: Mapping[str, int | float], release: int | None, device_ids: Set[int]
) -> str | None:
    """In words, that the values of a topic are not the sensors' own; `None` where they are, or where nothing says so.

    **Arguments:** `parameters` as the log's beginning states them, `release` its `ver_sw_release` (major, minor, patch
    and kind, a byte each), `device_ids` PX4's numbers of the sensors in the log.
    """
    if topic == "sensor_combined":
        active = [*_static(parameters, None), *(t for t in _THERMAL if parameters.get(t, 0) > 0)]
        if not active:
            return None
        return (
            f"sensor_combined holds values after {', '.join(active)}, in the vehicle's axes: {WRONG_PARAMETERS}. Read "
            "sensor_accel where the log has it."
        )
    if release is None or (release >> 24 & 255, release >> 16 & 255) >= _RAW_SINCE:
        return None
    active = _static(parameters, device_ids)
    if not active:
        return None
    return (
        f"before PX4 {'.'.join(map(str, _RAW_SINCE))} sensor_accel, sensor_gyro and sensor_mag hold values after "
        f"{', '.join(active)}: {WRONG_PARAMETERS}. Log with offsets 0 and scales 1, or with a later release."
    )


def _static(parameters: Mapping[str, int | float], device_ids: Set[int] | None) -> list[str]:
    """Sensors whose static parameters do something, of the devices where these are given: CAL_ACC0, …"""
    found = []
    for sensor in _SENSORS:
        for k in range(_MOST_SENSORS):
            name = f"CAL_{sensor}{k}"
            number = int(parameters.get(f"{name}_ID", 0))
            if not number or (device_ids is not None and number not in device_ids):
                continue
            values = [
                (parameters.get(f"{name}_{axis}{key}", neutral), neutral)
                for axis in "XYZ"
                for key, neutral in _NEUTRAL.items()
            ]
            if any(value != neutral for value, neutral in values):
                found.append(name)
    return found
