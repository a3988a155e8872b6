"""Which plan can show what; rows are (plan, its settings, triad, effects)."""

from collections.abc import Callable

import outside as X
import plans as P
import rig as R
import truth as T
from table import Plan


Row = tuple[Callable[..., Plan], dict, str, list]

SENSOR_TIME = [T.drift, T.bias_step, T.warm_up, T.interference]
TUMBLE_ACCEL = [T.second_order, T.third_order, T.odd_quadratic, T.scale_asymmetry, T.cross_coupling]
THERMAL = [T.thermal_lag, T.temperature_rate, T.thermal_hysteresis, T.temperature_order]
RATE = [T.rate_nonlinearity, T.scale_asymmetry]

MENU: list[Row] = [
    (P.tumble, dict(model="invariant"), "accel", TUMBLE_ACCEL + [T.settling] + SENSOR_TIME),
    (P.tumble, dict(model="reference"), "accel", TUMBLE_ACCEL + [R.table_axis_error]),
    (P.tumble, dict(model="reference", turns_logged=True), "accel", [R.pier_tilt, T.second_order]),
    (P.tumble, dict(model="both"), "accel", TUMBLE_ACCEL + [T.settling]),
    (P.tumble, dict(model="static gyro"), "gyro", [T.g_sensitivity, T.g2_sensitivity, T.magnetic]),
    (P.tumble, dict(model="static gyro"), "gyro", [R.earth_rate, T.drift, T.bias_step, T.warm_up]),
    (P.tumble, dict(model="both"), "gyro", [T.g_sensitivity, T.g2_sensitivity, T.magnetic]),
    (P.sweep, {}, "accel", THERMAL + [T.warm_up, T.bias_step, T.drift]),
    (P.sweep, {}, "accel", [T.second_order, T.cross_coupling, T.scale_asymmetry, T.settling]),
    (P.sweep, dict(degree=0), "accel", [T.temperature_dependence]),
    (P.pose, {}, "accel", THERMAL + [T.bias_step, T.interference]),
    (P.pose, {}, "gyro", THERMAL + [T.bias_step, T.interference, T.warm_up]),
    (P.pose, dict(degree=0), "gyro", [T.temperature_dependence]),
    (P.rate, {}, "gyro", RATE + [T.saturation, T.bias_step, T.drift, T.warm_up]),
    (P.rate, dict(slow=True), "gyro", [T.dead_band]),
    (P.rate, dict(oblique=True), "gyro", [T.cross_axis_rate, T.rate_nonlinearity]),
    (P.mixed, {}, "gyro", RATE + [T.g_sensitivity, T.g2_sensitivity, T.magnetic, R.earth_rate]),
    (P.mixed, {}, "accel", TUMBLE_ACCEL),
    (P.mixed, dict(accel="reference"), "accel", [T.size_effect, T.second_order]),
    (P.thermal_mixed, {}, "accel", THERMAL + [T.second_order, T.bias_step]),
    (P.thermal_mixed, {}, "gyro", THERMAL + [T.g_sensitivity, T.rate_nonlinearity, T.warm_up]),
    (P.thermal_rate, {}, "gyro", THERMAL + RATE + [T.bias_step]),
]
OPEN: list[Row] = [
    (P.pose, {}, "accel", [X.x_bump, X.x_ripple, X.x_rate_times_temperature, X.x_burst]),
    (P.pose, {}, "gyro", [X.x_bump, X.x_ripple, X.x_rate_times_temperature, X.x_burst]),
    (P.sweep, {}, "accel", [X.x_bump, X.x_ripple, X.x_cubic_times_temperature, X.x_burst]),
    (P.thermal_rate, {}, "gyro", [X.x_bump, X.x_ripple, X.x_rate_times_temperature]),
    (P.rate, {}, "gyro", [X.x_kink_in_rate, X.x_burst]),
    (P.tumble, dict(model="invariant", count=36), "accel", [X.x_notch_in_force, X.x_burst]),
]
ALIASED: list[Row] = [
    (P.tumble, dict(model="reference", count=6), "accel", [T.third_order, T.odd_quadratic]),
    (P.tumble, dict(model="reference"), "accel", [R.gravity_error, R.table_misalignment]),
    (P.tumble, dict(model="invariant"), "accel", [R.gravity_error]),
    (P.rate, {}, "gyro", [R.rate_scale_error, R.table_misalignment]),
    (P.tumble, dict(model="invariant", count=12), "accel", [T.third_order, T.odd_quadratic]),
    (P.tumble, dict(model="reference", count=24), "accel", [T.third_order, T.odd_quadratic]),
    (P.tumble, dict(model="reference", count=12), "accel", [T.second_order, T.scale_asymmetry]),
    (
        P.sweep,
        dict(shape="up"),
        "accel",
        [T.thermal_hysteresis, T.drift, T.temperature_rate, T.warm_up],
    ),
    (P.pose, dict(shape="up"), "gyro", [T.thermal_hysteresis, T.drift, T.thermal_lag, T.warm_up]),
]
