"""Wrong shapes and units are said in one line that names the field: run as a user has it, without checks of types."""

import json
import os
import subprocess
import sys

import pytest


SETUP = """
import warnings
import numpy as np, jax, inertiax as ix
from inertiax.calibrate.pipeline import calibrate
from inertiax.calibration.magnetometers import MagnetometerCalibration
from inertiax.estimators import GravityRotation
from inertiax.navigation.strapdown import State, with_coefficients
r = np.random.default_rng(0)
u = r.normal(size=(2, 24, 3))
a = 9.81 * u / np.linalg.norm(u, axis=-1, keepdims=True)
w = r.normal(size=(2, 24, 3))
t = np.arange(10) * 0.01
D, R = ix.Dwells.from_arrays, ix.Recording.from_arrays
x = np.full((10, 3), 5.66)
log = ix.Recording(t, x, temperature=20.0 + t)
still = ix.Recording(np.arange(500) * 0.01, np.tile([0.0, 0.0, 9.81], (500, 1)), temperature=np.full(500, 20.0))
frame = {"time": t, **{f"gyro_{k}": np.full(10, 0.5) for k in "xyz"}}
rests = w * np.where(np.arange(24) < 18, 7e-5, 1.0)[:, None]  # most rows see the Earth alone
mostly = rests + 2e-3  # biased by 30 times as much
hidden = np.ma.masked_array(a, mask=np.zeros(a.shape, bool))
hidden[0, 3] = np.ma.masked
one = (t, t, t, t, np.arange(10), np.arange(10))
names = ("accel.bias[0]", "accel.bias[1]", "accel.bias[2]")
triad = ix.TriadCalibration(ix.Curve(ix.Constant(), np.zeros((1, 3))), np.eye(3), names, "static")
c = ix.Calibration(gravity=9.81, accel=triad)
many = ix.stack([c, c])
curve = ix.Curve(ix.Polynomial(1, 0.0, 40.0), np.zeros((2, 3)))
field = ("mag.bias[0]", "mag.bias[1]", "mag.bias[2]")
magnetic = MagnetometerCalibration(ix.TriadCalibration(curve, np.eye(6), field, "field"), 48e-6)
mag = ix.Calibration(gravity=9.81, mag=magnetic).mag
warm = ix.Calibration(gravity=9.81, accel=ix.TriadCalibration(curve, np.eye(6), names, "static"))
v = np.zeros(3)
nav, key = ix.navigation, jax.random.PRNGKey(0)
assert_ = lambda so: so or 1 / 0
noise, level = nav.ImuNoise(nav.TriadNoise(1e-3), nav.TriadNoise(1e-4)), nav.LevelFrame(0.9)
F = nav.Filter(c, "accel.bias", noise=noise, frame=level, samples=2)
sigmas = {"attitude_sigma": 0.1, "velocity_sigma": 0.1, "position_sigma": 1.0}
S = F.start(np.eye(3), v, v, **sigmas)
degrees = np.array([51.566, 37.6, 150.0]) + 1e-4 * np.arange(5)[:, None]
run = lambda *fixes, accel=x, temperature=20.0 + t, step=0.01: F.run(
    S, nav.ImuData(accel, 0 * x, temperature, step), fixes
)
warnings.simplefilter("error")
"""

# An expression, and words of the message that name the field.
CASES = [
    ("D()", "give `accel`, `gyro` or both"),
    ("D(a[0, 0])", "(accel=...)`: shape (3,)"),
    ("D(a[..., :2])", "(accel=...)`: shape (2, 24, 2)"),
    ("D(a / 9.81)", "(accel=...)`: median magnitude"),
    ("D(a * 1000)", "(accel=...)`: median magnitude"),
    ("D([['a', 'b', 'c']])", "(accel=...)`: must be an array of real numbers"),
    ("D(hidden)", "(accel=...)`: holds masked elements; leave their rows out, or fill them"),
    ("ix.Dwells(*one, valid=t == t, accel=hidden[0, :10])", "`Dwells(accel=...)`: holds masked elements"),
    ("R(t, hidden[0, :10])", "`Recording.from_arrays(accel=...)`: holds masked elements"),
    ("R(t[:0], x[:0])", "`Recording.from_arrays`: no rows; at least one sample is needed"),
    ("D(np.where(u > 2, np.nan, a))", "(accel=...)`: not a finite number at dwell"),
    ("D(gyro=w * 5730)", "(gyro=...)`: median magnitude"),
    ("D(gyro=w * 57.3, reference_gyro=w)", "(gyro=...)`: 57.3 times its counterpart"),
    ("D(gyro=w, reference_gyro=w * 57.3)", "(reference_gyro=...)`: 57.3 times its counterpart"),
    ("D(gyro=mostly, reference_gyro=rests * 57.3)", "(reference_gyro=...)`: 57.3 times its counterpart"),
    ("D(gyro=mostly * 57.3, reference_gyro=rests)", "(gyro=...)`: 57.3 times its counterpart"),
    ("D(a, reference_accel=a / 9.81)", "(reference_accel=...)`: median magnitude"),
    ("D(a, w[:1])", "(gyro=...)`: shape (1, 24, 3)"),
    ("D(a, temperature=293.0)", "(temperature=...)`: from 293"),
    ("D(a, temperature=np.linspace(-40.0, 230.0, 24))", "from -40 to 230; it is in °C, from -100 to 200 (Fahrenheit?)"),
    ("ix.PaperIteration(ix.Invariant(9.81), ix.Constant())", "`PaperIteration.plan(estimator, basis, dwells)` finds"),
    ("D(a, temperature=np.zeros(5))", "(temperature=...)`: shape (5,)"),
    ("D(a, temperature=np.nan)", "(temperature=...)`: not a finite number"),
    ("D(a, sigma=-1e-3)", "(sigma=...)`: -0.001; it is in m/s² for accel"),
    ("D(a, sigma=[[1e-3, 2e-3, -3e-3]])", "(sigma=...)`: -0.003"),
    ("D(a, sigma=1.0)", "(sigma=...)`: 1; it is in m/s² for accel, from 0 to 0.5"),
    ("D(a, sigma=0.0)", "(sigma=...)`: 0; it must be above 0 m/s² for accel. Leave it out"),
    ("D(a, sigma=-1e-6 * np.tile(np.eye(3), (2, 24, 1, 1)))", "a variance is -1e-06"),
    ("D(a / 9.81e-3)", "(accel=...)`: median magnitude 1000; it is in m/s², about 9.8 at rest (in mg?)"),
    ("D(a, sigma=np.ones(2) * 1e-3)", "by axis, (2, 24) by dwell"),
    ("D(a, sigma=np.eye(3)[None, None, :2])", "covariances are (2, 24, 3, 3)"),
    ("D(a, sigma=1e-3 * np.ones(4))", "(sigma=...)`: shape (4,)"),
    ("D(a, w, sigma=1e-3)", "(sigma=...)`: with both triads it is a pair"),
    ("D(a, experiment=0.5)", "(experiment=...)`: must hold whole numbers"),
    ("D(a, position=np.zeros((3, 3)))", "(position=...)`: shape (3, 3)"),
    ("D(a, valid=2)", "(valid=...)`: must hold true and false"),
    ("ix.fit(D(a), accel=ix.Invariant(gravity=1.0))", "(accel=...)`: gravity is 1"),
    ("ix.fit(a)", "`fit(dwells)`: ndarray is no Dwells; make them by `Dwells.from_arrays(accel, gyro)`"),
    ("ix.fit(None)", "`fit(dwells)`: NoneType is no Dwells"),
    ("ix.fit(log)", "`fit(dwells)`: Recording is no Dwells; a recording's are `reduce_to_dwells(recording)`"),
    ("ix.joint_fit(ix.Invariant(9.81), ix.Constant(), log)", "dwells)`: Recording is no Dwells"),
    (
        "ix.fit(D(a, w), accel=ix.Invariant(9.80), gyro=ix.StaticGyro(9.83))",
        "`fit(gyro=...)`: gravity is 9.83, but that of accel is 9.8; a device is calibrated in one place",
    ),
    ("ix.fit(D(a), gyro=ix.StaticGyro(gravity=9.81))", "(gyro=...)`: the dwells have no gyro"),
    ("ix.fit(D(gyro=w), gyro=ix.ReferenceGyro(gravity=9.81))", "no reference_gyro"),
    ("ix.fit(D(a), degree=9)", "(degree=9)`: must be from 0 to 6"),
    ("ix.fit(D(a, temperature=20.0), degree=1)", "temperature does not change"),
    ("ix.fit(D(a), degree=1)", "the dwells have no temperature; give"),
    ("ix.fit(D(a), degree=1.5)", "(degree=1.5)`: must be one whole number"),
    ("ix.fit(D(a), degree={'bias': 1})", "(degree={'bias': 1})`: must be one whole number"),
    ("ix.fit(D(a), accel=ix.Invariant)", "`fit(accel=...)`: Invariant is a class"),
    ("ix.fit(D(a), accel='invariant')", "`fit(accel=...)`: str is no estimator"),
    ("ix.fit(D(a), accel=ix.Invariant(gravity=np.full(2, 9.81)))", "gravity has shape (2,); it is one number"),
    ("ix.joint_fit(ix.Invariant, ix.Constant(), D(a[0]))", "Invariant is a class"),
    ("ix.fit(D(a), accel=ix.StaticGyro(gravity=9.81))", "StaticGyro is no estimator for it"),
    ("ix.fit(D(a, w), gyro=GravityRotation(gravity=9.81))", "import calibrate`, `calibrate(Campaign(recording, Site("),
    ("calibrate(still)", "`calibrate(campaign)`: Recording is no Campaign; a recording's is `Campaign("),
    ("ix.Campaign(x)", "`Campaign(recordings=...)`: ndarray is no Recording"),
    ("jax.jit(lambda q: R(t, q).accel)(x)", "`Recording.from_arrays(accel=...)`: a recording is of the host"),
    ("jax.jit(lambda q: ix.Recording(t, q).accel)(x)", "`Recording(...)`: a recording is of the host"),
    ("jax.jit(lambda c: ix.write_calibration(c, 'never.json'))(c)", "not known in traced code; write what came out"),
    ("jax.jit(ix.fit)(D(a))", "does not work in traced code"),
    ("R(t, x, temperature=np.full(10, 300.0))", "(temperature=...)`: from 300"),
    ("R(t, x / 9.81)", "(accel=...)`: median magnitude"),
    ("R(t, x[:, :2])", "(accel=...)`: shape (10, 2)"),
    ("R(t, x[:5])", "'accel' has 5 rows but 'time' has 10"),
    ("R(accel=x)", "(time=...)`: give either"),
    ("R(t, x, colour=t)", "(colour=...)`: is no column"),
    ("ix.Recording.from_frame(7)", "got int"),
    ("ix.Recording.from_frame({'time': t}, columns={'accel': ('a', 'b', 'c')})", "no column 'a' for 'accel'"),
    ("State(np.eye(3), v, np.array([55.0, 0.5, 0.0]))", "State(origin=...)`: latitude is 55"),
    ("State(2 * np.eye(3), v, np.array([0.9, 0.5, 0.0]))", "State(attitude=...)`"),
    ("State(np.eye(3), v, np.array([0.9, 0.5, -2e4]))", "height is -20000"),
    ("State(np.eye(3), v + 1e5, np.array([0.9, 0.5, 0.0]))", "State(velocity=...)`"),
    ("with_coefficients(c, np.zeros(4))", "values have shape (4,), but the block has 3"),
    ("c.with_values('*.bias', np.zeros(2))", "values have shape (2,), but the block has 3"),
    ("c.block('gyro.bias')", "no coefficient is called that"),
    ("c.log_density(np.zeros(2))", "values have shape (2,)"),
    ("c.with_covariance(np.eye(2))", "shape (2, 2), but the calibration has 3"),
    ("c.with_covariance(-np.eye(3))", "a variance is -1; none is below 0"),
    ("c.with_covariance(np.triu(np.ones((3, 3))))", "the matrix is not symmetric"),
    ("c.with_covariance(2.0 * np.ones((3, 3)) - np.eye(3))", "larger than its two standard deviations allow"),
    ("warm(v, v, 293.15)", "temperature is 293.15; it is in °C, from -100 to 200 (kelvin?)"),
    ("warm(v, v, 20.0 + t)", "takes one temperature but got shape (10,)"),
    ("warm.distort(v, v, 293.15)", "temperature is 293.15; it is in °C"),
    ("c(v, np.array([100.0, 20.0, 300.0]), 20.0)", "gyro has magnitude 316.86; it is in rad/s (deg/s?)"),
    ("c.distort(2e4 + v, v, 20.0)", "force has magnitude 34641; it is in m/s²"),
    ("mag(v + 30.0, 20.0)", "mag(mag, temperature, current)`: mag has magnitude 51.9615; it is in T, about 5e-5 (uT?)"),
    ("mag(v, 293.15, 0.0)", "temperature is 293.15; it is in °C"),
    ("mag(v, 20.0, None)", "current is None; give A"),
    ("c(x, x, 20.0)", "accel has shape (10, 3), but one sample has (3,)"),
    ("c.distort(v, x, 20.0)", "rate has shape (10, 3)"),
    ("triad.curve(np.zeros(1))", "takes one temperature but got shape (1,)"),
    ("ix.TriadCalibration(triad.curve, np.eye(3), names[:2], 'static')", "2 names"),
    ("ix.TriadCalibration(triad.curve, np.eye(2), names, 'static')", "(covariance=...)`: shape (2, 2)"),
    ("ix.Calibration(gravity=9.81, gyro=triad)", "(gyro=...)`: 'accel.bias[0]'"),
    ("ix.Curve(ix.Polynomial(2, 0.0, 1.0), np.zeros((2, 1)))", "3 functions"),
    ("ix.Polynomial(1, 70.0, -40.0)", "low < high"),
    ("ix.Polynomial(1, 263.0, 323.0)", "`Polynomial(low=..., high=...)`: from 263 to 323; it is in °C"),
    ("ix.CubicSpline((263.0, 323.0))", "`CubicSpline(knots=...)`: from 263 to 323; it is in °C"),
    ("ix.Twin(c, sample_rate=0.01)", "(sample_rate=...)`: must be 0.1 Hz or more; got 0.01 (the step in s?)"),
    ("ix.Twin(c, delay=5.0)", "(delay=...)`: must be from 0 to 1 s; got 5.0 (ms?)"),
    ("ix.Twin(c, {'accel': {'N': 150.0}})", "accel N is 150"),
    ("ix.Twin(c, {'accel': {'N': -1}})", "accel N is -1; it is in SI"),
    ("ix.Twin(c).init(20.0, key)", "key is 20.0; make one by"),
    ("ix.Twin(c, {'accel': {'X': 1e-3}})", "accel has no 'X'"),
    ("ix.Twin(c).step(ix.Twin(c).init(jax.random.PRNGKey(0), 20.0), x, v, 20.0)", "force has shape (10, 3)"),
    ("ix.Twin(c, {'imu': {}})", "'imu' is neither 'accel' nor 'gyro'"),
    ("ix.Twin(c, {'accel': {'N': np.ones(2)}})", "accel N has shape (2,)"),
    ("ix.Twin(c, {'accel': {'filter': [-1.5]}})", "accel filter [-1.5] is not stable"),
    ("ix.Twin(c, {'accel': {'filter': 0.5}})", "accel filter has shape (); it is (order,) or (3, order)"),
    ("ix.Twin(c, {'accel': {'resolution': -1.0}})", "accel resolution is -1"),
    ("ix.Twin(c, {'gyro': {'full_scale': 0.0}})", "gyro full_scale is 0"),
    ("ix.Twin(c).init(key, 300.0)", "`twin.init(temperature=...)`: from 300"),
    ("ix.Twin(c).init(key, t)", "temperature has shape (10,)"),
    ("ix.stack([])", "nothing to stack"),
    ("ix.stack([c, c.changed(accel=None)])", "number 1 differs from the first in its accel"),
    ("ix.unstack(c)", "leaves begin with axes"),
    ("ix.CubicSpline((20.0, 10.0))", "`CubicSpline(knots=...)` needs at least 2 increasing"),
    ("ix.Curve(ix.Constant(), v)", "`Curve(coefficients=...)`: shape (3,)"),
    ("ix.AccelerometerErrors(np.zeros(2), np.eye(3))", "`AccelerometerErrors(bias=...)`: shape (2,)"),
    ("ix.AccelerometerErrors(v, v)", "`AccelerometerErrors(matrix=...)`: shape (3,)"),
    ("ix.GyroErrors(v, np.eye(3), v)", "`GyroErrors(g_sensitivity=...)`: shape (3,)"),
    ("ix.distort_accel(ix.AccelerometerErrors.zero(), x)", "force has shape (10, 3)"),
    ("ix.compensate_accel(ix.AccelerometerErrors.zero(), x)", "output has shape (10, 3)"),
    ("ix.distort_gyro(ix.GyroErrors.zero(), x, v, 9.81)", "rate has shape (10, 3)"),
    ("ix.compensate_gyro(ix.GyroErrors.zero(), v, v[:2], 9.81)", "force has shape (2,)"),
    ("ix.Site(1.0)", "`Site(gravity=...)`: 1; it is in m/s²"),
    ("ix.Site(9.8, 55.0)", "`Site(latitude=...)`: 55; it is in rad"),
    ("ix.Rig(position_uncertainty=2.0)", "`Rig(position_uncertainty=...)`: 2; it is in rad"),
    ("ix.Rig(rate_uncertainty=5.0)", "`Rig(rate_uncertainty=...)`: 5"),
    ("ix.Rig(temperature_uncertainty=-1.0)", "`Rig(temperature_uncertainty=...)`: -1"),
    ("ix.Calibration(gravity=1.0)", "`Calibration(gravity=...)`: 1; it is in m/s²"),
    ("ix.Calibration(gravity=np.full(2, 9.81))", "`Calibration(gravity=...)`: shape (2,)"),
    ("ix.Calibration(9.81, temperature_range=(70.0, -40.0))", "(temperature_range=...)`: from 70 to -40"),
    ("ix.Calibration(9.81, temperature_range=(233.0, 343.0))", "(temperature_range=...)`: from 233"),
    ("ix.Calibration(9.81, triad, cross_covariance=np.eye(2))", "(cross_covariance=...)`: shape (2, 2)"),
    ("ix.TriadCalibration(triad.curve, -np.eye(3), names, 'static')", "a variance is -1"),
    ("ix.FittedEffect('drift', 'imu', (0,), (), v[:1], np.eye(1), '1')", "(triad=...)`: 'imu'"),
    ("ix.FittedEffect('drift', 'accel', (3,), (), v[:1], np.eye(1), '1')", "(channels=...)`: (3,)"),
    ("ix.FittedEffect('drift', 'accel', (0,), (), v, np.eye(1), '1')", "(covariance=...)`: shape (1, 1)"),
    ("ix.FittedEffect('drift', 'accel', (0,), (), v[:1], np.eye(1), '1')", "settings are [] but must be ['on']"),
    ("ix.FittedEffect('second_order', 'accel', (0,), (), v[:1], np.eye(1), '1')", "it must be 'm/s^2/g^2'"),
    ("ix.FittedEffect('g2_sensitivity', 'accel', (0,), (), v[:1], np.eye(1), '1')", "is one of gyro, not of accel"),
    ("c.to_frame([300.0])", "(temperatures=...)`: from 300"),
    ("c.samples(key, 0)", "n is 0; it must be 1 or more"),
    ("c.samples(10, key)", "key is 10; make one by"),
    ("c.samples(key, 2.5)", "n is 2.5; it must be 1 or more"),
    ("c.conditioned('*.bias', v[:2])", "values have shape (2,), but the block has 3"),
    ("c.changed(gryo=None)", "`calibration.changed(gryo=...)`: it has gravity, accel, gyro, device"),
    ("many(v, v, 20.0)", "(2,) devices are stacked; `jax.vmap` over them"),
    ("many.distort(v, v, 20.0)", "(2,) devices are stacked"),
    ("many.samples(key, 3)", "(2,) devices are stacked"),
    ("many.log_density(v)", "(2,) devices are stacked"),
    ("many.accel.parameters(20.0)", "(2,) devices are stacked"),
    ("many.accel.standard_deviations(20.0)", "(2,) devices are stacked"),
    ("many.accel.over(t)", "(2,) devices are stacked"),
    ("many.summary()", "(2,) devices are stacked"),
    ("ix.write_calibration(many, 'never.json')", "(2,) devices are stacked"),
    ("ix.read_calibration('/nowhere.json')", "/nowhere.json: cannot be read"),
    ("ix.load_campaign('/nowhere')", "/nowhere: does not exist"),
    ("c(v, None, 20.0)", "gyro is None; give zeros for a triad that the device lacks"),
    ("warm(v, v, None)", "temperature is None; give °C"),
    ("c.block(0)", "`calibration.block(0)`: a block is chosen by names"),
    ("c.block([0, 1])", "`calibration.block([0, 1])`: a block is chosen by names"),
    ("warm.block('*.bias.c3')", "there are accel.bias, each with .c0 .c1 over temperature"),
    ("c.block('gyro.bias')", "there are accel.bias."),
    ("ix.reduce_to_dwells(a)", "`reduce_to_dwells(recordings)`: ndarray is no Recording"),
    ("ix.Recording(t, x, temperature=np.zeros((10, 1, 1)))", "'temperature' has shape (10, 1, 1); it must be"),
    ("ix.Recording(t, x[:, :2])", "'accel' has shape (10, 2); it must be (time, 3)"),
    ("ix.Recording.from_frame({**frame, 'position': t})", "position`: must hold whole numbers; row 1 is 0.01"),
    ("ix.Recording.from_frame({**frame, 'time': 1e3 * t})", "samples are 10 s apart, in which the device turns by"),
    ("ix.Recording.from_frame({**frame, 'time': 1e3 * t})", "it is in s (in ms?)."),  # 100 Hz
    ("ix.Recording.from_frame({**frame, 'time': 1e6 * t})", "samples are 10000 s apart"),
    ("ix.Recording.from_frame({**frame, 'time': 1e6 * t})", "it is in s (in µs?)."),
    ("ix.Recording.from_frame({**frame, 'time': 1e9 * t})", "it is in s (in ns?)."),
    ("ix.Recording.from_frame({**frame, 'time': 5e4 * t})", "it is in s (in ms or µs?)."),  # 2 Hz or 2 kHz
    # A second of 2023: single precision has 24 bits, and 1.7e9 lies between 2^30 and 2^31, so that they are 2^7 apart.
    ("R(np.float32(1.7e9 + t), x)", "rows 0 and 1 are both 1.7e+09 s in 32 bits, which tell 1.3e+02 s apart there"),
    ("R(jax.numpy.asarray(1.7e9 + t, 'float32'), x)", "give 64 bits (NumPy), or count from the first sample"),
    ("R(np.float32(np.maximum(t, 0.01)), x)", "'time' must increase strictly, but row 1 (0.010000 s) does not come"),
    ("ix.Twin(c, {'accel': {'full_scale': 2.0}})", "accel full_scale is 2; it is in m/s², from 9.7"),
    ("ix.Twin(c, {'gyro': {'full_scale': 2000.0}})", "gyro full_scale is 2000; it is in rad/s"),
    ("ix.reduce_to_dwells([])", "(recordings)`: no recordings"),
    ("ix.joint_fit(ix.Invariant(gravity=9.81), ix.Constant(), D(gyro=w[0]))", "reads accel, which"),
    ("ix.joint_fit(ix.ReferenceAccel(), ix.Constant(), D(a[0]))", "reads reference_accel, which"),
    ("ix.joint_fit(ix.Invariant(gravity=9.81), ix.Constant(), D(a))", "leading axes (2,)"),
    ("ix.joint_fit(ix.Invariant(gravity=9.81), ix.Constant(), D(a[0]), start=np.eye(3))", "start has shape (3, 3)"),
    ("ix.derivatives(ix.fit(D(a[0], sigma=1e-3)), [])", "no sources"),
    ("ix.derivatives(ix.fit(D(a[0], sigma=1e-3)), ['gravity'])", "'gravity' is no source"),
    ("ix.derivatives(ix.fit(D(a[0], sigma=1e-3)), [ix.sources.table_rate(1e-5)])", "'table rate' changes nothing"),
    ("ix.sources.gravity(9.8)", "reference g (size=...)`: 9.8; it is in m/s^2"),
    ("ix.sources.positioning(5.0)", "positioning (size=...)`: 5; it is in rad"),
    ("ix.sources.probe_offset(-1.0)", "probe offset (size=...)`: -1"),
    ("nav.LevelFrame(55.0)", "`LevelFrame(latitude=...)` is in rad"),
    ("nav.LevelFrame(0.9, 1e9)", "`LevelFrame(height=...)` is in m"),
    ("nav.LevelFrame(0.9, gravity=1.0)", "`LevelFrame(gravity=...)` is in m/s²"),
    ("nav.TriadNoise(white=5.0)", "`TriadNoise(white=...)`: 5; it is in SI"),
    ("nav.ImuNoise(nav.TriadNoise(1e-3), nav.TriadNoise(0.9))", "`ImuNoise(gyro=...): white`: 0.9; it is in SI"),
    ("nav.TriadNoise(1e-3, walk=-1e-5)", "`TriadNoise(walk=...)`: -1e-05"),
    ("nav.Filter(c, 'gyro.bias', noise=noise, frame=level)", "`Filter(states='gyro.bias')` chooses none"),
    ("nav.Filter(many, '*', noise=noise, frame=level)", "`Filter(calibration)`: (2,) devices are stacked"),
    ("F.start(2.0 * np.eye(3), v, v, **sigmas)", "`Filter.start(attitude=...)`: it is not a rotation"),
    ("F.start(np.eye(3), v[:2], v, **sigmas)", "velocity has shape (2,)"),
    ("F.start(np.eye(3), v, v, **sigmas | {'attitude_sigma': 5.0})", "(attitude_sigma=...)`: 5; it is in rad"),
    ("F.start(np.eye(3), v, v, **sigmas | {'position_sigma': -1.0})", "(position_sigma=...)`: -1"),
    ("F.start(np.diag([1.0, 1.0, -1.0]), v, v, **sigmas)", "its determinant is -1: a mirror"),
    ("run(accel=np.where(np.arange(30).reshape(10, 3) == 7, np.nan, x))", "not a finite number at sample 2"),
    ("nav.ImuData(x, 0 * x, 20.0, 0.01)", "`ImuData(temperature=...)`: one number; it is one a sample"),
    ("run(accel=x[:5])", "`ImuData(accel=...)`: shape (5, 3); beside temperatures of shape (10,)"),
    ("run(temperature=300.0 + t)", "`ImuData(temperature=...)`: from 300"),
    ("run(step=-0.01)", "`ImuData(step=...)`: -0.01; it is in s"),
    ("run(step=100.0)", "the sample rate, or ms?"),
    ("run(step=10.0)", "the sample rate, or ms?"),
    ("run(accel=x / 9.81)", "`ImuData(accel=...)`: median magnitude 0.999"),
    ("run(accel=1e3 * x)", "in mm/s² or counts?"),
    ("nav.ImuData(x, 90.0 + x, 20.0 + t, 0.01)", "`ImuData(gyro=...)`: median magnitude 165"),
    ("run(nav.Position(np.zeros((3, 3)), 1.0))", "`Position(value=...)` has 3 rows"),
    ("run(nav.Position(np.full((5, 3), np.nan), 1.0))", "row 0 is not a finite number; give `valid`"),
    ("run(nav.Velocity(np.where(np.eye(5, 3), np.nan, 0.0), 1.0, np.arange(5) > 1))", "row 2 is not a finite number"),
    ("run(nav.Position(np.zeros((5, 2)), 1.0))", "`Position(value=...)` has shape (5, 2)"),
    ("run(nav.Position(np.zeros((5, 3)), np.ones(2)))", "`Position(sigma=...)` has shape (2,)"),
    ("run(nav.Attitude(np.zeros((5, 3)), 0.1))", "`Attitude(value=...)` has shape (5, 3)"),
    ("run(nav.Velocity(np.zeros((5, 3)), -1.0))", "`Velocity(sigma=...)` is -1"),
    ("run(nav.Position(np.zeros((5, 3)), 0.0))", "`Position(sigma=...)` is 0; it must be above 0"),
    ("run(nav.Position(np.zeros((5, 3)), 1.0, gate=-1.0))", "`Position(gate=...)` is -1; it must be above 0"),
    ("run(nav.Position(np.full((5, 3), np.nan), 1.0, np.ones(4, bool)))", "`Position(valid=...)` has shape (4,)"),
    ("run(nav.Position(np.zeros((5, 3)), [1.0, 1.0, 0.0]))", "`Position(sigma=...)` is 0; it must be above 0"),
    ("run(nav.Position(degrees, 1.0))", "`Position(value=...)` stays at 51.566, which is the origin's latitude"),
    ("run(nav.Position(degrees[:, [1, 0, 2]], 1.0))", "the origin's latitude in degrees; positions are metres"),
    ("run(nav.Position(np.deg2rad(degrees), 1.0))", "which is the origin's latitude in radians"),
    ("run(nav.Position(np.full((5, 3), [2.8e6, 2.2e6, 5.3e6]), 1.0))", "`Position(value=...)`: 5.3e+06 m"),
    ("F.start(np.eye(3), v, v + 3e6, **sigmas)", "`Filter.start(position=...)`: 3e+06 m; positions are metres east"),
]  # fmt: skip

# What a user may mean, however unusual it is. All runs of the filter are one program.
ACCEPTED = [
    "D(100 * a, reference_accel=100 * a)",  # a centrifuge
    "D(np.where(np.arange(24)[:, None] > 2, a, 0.0), sigma=1e-3 * (np.arange(24) > 2), valid=np.arange(24) > 2)",
    "c(v, v, 20.0)",  # free fall
    "D(np.ma.masked_array(a, mask=False))",  # nothing is masked
    "run(nav.Position(np.where(np.eye(5, 3), np.nan, 0.0), np.ones((5, 1)), np.arange(5) > 2))",
    "ix.reduce_to_dwells(still)",  # without a list
    "ix.Recording.from_frame({**frame, 'time': 1e2 * t})",  # a table's means, one a second
    "ix.fit(D(a, w), accel=ix.Invariant(np.float32(9.81)), gyro=ix.StaticGyro(9.81))",
    "assert_(log.temperature.shape == (10, 1))",
    "assert_(len(repr(ix.Twin(c))) < 300 and 'Twin(' in repr(ix.Twin(c)))",
    "c(1000.0 + v, 60.0 + v, np.nan)",  # a shock, a spin, no probe
    "c(v, v, 293.15)",  # constants do not look at it
    "assert_(len(jax.vmap(c)(x, x)) == len(c.distort(v, v)) == 2)",  # nor need it
    "assert_(ix.Campaign(still).devices == ('',))",  # without a tuple
    "ix.Campaign((), ix.Site(np.float64(9.81), np.deg2rad(48.2)), ix.Rig(np.float32(1e-5)))",  # NumPy's numbers
    "ix.Polynomial(np.int64(2), np.float64(0.0), np.float64(40.0))",
    "jax.jit(lambda q: F.ends(nav.ImuData(x, 0 * x, t, q)))(0.01)",
    "nav.Filter(c, (), noise=noise, frame=nav.LevelFrame(np.deg2rad(48.2)), samples=np.int64(2))",
    "jax.jit(warm)(v, v, 293.15)",
    "jax.vmap(warm, (None, None, 0))(v, v, 300.0 + t)",
    "nav.ImuData(0.0 * x, x, t, 0.01)",  # an orbit
    "nav.ImuData(100.0 * x, x, t, 0.01)",
    "nav.ImuData(0, 0, 0, None)",  # axes to map over
    "jax.eval_shape(lambda d: d.accel, nav.ImuData(*(jax.ShapeDtypeStruct(q.shape, 'f4') for q in (x, x, t)), 0.01))",
    "jax.jit(lambda q: nav.ImuData(q / 9.81, q, t, 0.01).accel)(x)",
    "nav.ImuData(*(jax.numpy.asarray(q) for q in (x, x, t)), jax.numpy.asarray(0.01))",
    "nav.ImuData(np.stack([x, x]), np.stack([x, x]), np.stack([t, t]), 0.01)",
    "nav.ImuData(x, x, np.full(10, np.nan), 0.01)",
    "c.with_covariance(np.zeros((3, 3)))",
    "c.with_covariance(np.full((3, 3), np.nan))",
    "ix.Twin(c, delay=0.5, sample_rate=1.0)",
    "run(nav.Position(degrees + 3.0 * np.arange(5)[:, None], np.ones((5, 1)), t[:5] >= 0))",  # metres all the same
    "run(nav.Position(np.full((5, 3), np.nan), np.zeros((5, 1)), np.zeros(5, bool)))",  # no fix
]

RUN = """
import json, sys
for case in json.load(sys.stdin):
    try:
        eval(case)
        said = "nothing"
    except ValueError as error:
        said = str(error)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
    print(json.dumps(said))
"""


@pytest.mark.slow
def test_each_says_the_field_in_one_line():
    cases = [*CASES, *((case, "nothing") for case in ACCEPTED)]
    ran = subprocess.run(
        [sys.executable, "-c", SETUP + RUN],
        input=json.dumps([case for case, _ in cases]),
        env={**os.environ, "JAX_ENABLE_X64": "0"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = [json.loads(line) for line in ran.stdout.splitlines()]
    assert len(said) == len(cases), ran.stderr[-2000:]
    wrong = [(c, s) for (c, words), s in zip(cases, said) if words not in s or "\n" in s]
    assert not wrong
