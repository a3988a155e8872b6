"""Wrong shapes and units are said in one line that names the field: run as a user has it, without checks of types."""

import json
import os
import subprocess
import sys

import pytest


SETUP = """
import numpy as np, jax, inertiax as ix
from inertiax.navigation.strapdown import State, with_coefficients
r = np.random.default_rng(0)
u = r.normal(size=(2, 24, 3))
a = 9.81 * u / np.linalg.norm(u, axis=-1, keepdims=True)
w = r.normal(size=(2, 24, 3))
t = np.arange(10) * 0.01
D, R = ix.Dwells.from_arrays, ix.Recording.from_arrays
x = np.full((10, 3), 5.66)
names = ("accel.bias[0]", "accel.bias[1]", "accel.bias[2]")
triad = ix.TriadCalibration(ix.Curve(ix.Constant(), np.zeros((1, 3))), np.eye(3), names, "static")
c = ix.Calibration(gravity=9.81, accel=triad)
v = np.zeros(3)
"""

# An expression, and words of the message that name the field.
CASES = [
    ("D()", "give `accel`, `gyro` or both"),
    ("D(a[0, 0])", "(accel=...)`: shape (3,)"),
    ("D(a[..., :2])", "(accel=...)`: shape (2, 24, 2)"),
    ("D(a / 9.81)", "(accel=...)`: median magnitude"),
    ("D(a * 1000)", "(accel=...)`: median magnitude"),
    ("D([['a', 'b', 'c']])", "(accel=...)`: must be an array of real numbers"),
    ("D(np.where(u > 2, np.nan, a))", "(accel=...)`: not a finite number at dwell"),
    ("D(gyro=w * 5730)", "(gyro=...)`: median magnitude"),
    ("D(gyro=w * 57.3, reference_gyro=w)", "(gyro=...)`: 57.3 times its counterpart"),
    ("D(gyro=w, reference_gyro=w * 57.3)", "(reference_gyro=...)`: 57.3 times its counterpart"),
    ("D(a, reference_accel=a / 9.81)", "(reference_accel=...)`: median magnitude"),
    ("D(a, w[:1])", "(gyro=...)`: shape (1, 24, 3)"),
    ("D(a, temperature=293.0)", "(temperature=...)`: from 293"),
    ("D(a, temperature=np.zeros(5))", "(temperature=...)`: shape (5,)"),
    ("D(a, temperature=np.nan)", "(temperature=...)`: not a finite number"),
    ("D(a, sigma=-1e-3)", "(sigma=...)`: must be from 0"),
    ("D(a, sigma=np.ones(4))", "(sigma=...)`: shape (4,)"),
    ("D(a, w, sigma=1e-3)", "(sigma=...)`: with both triads it is a pair"),
    ("D(a, experiment=0.5)", "(experiment=...)`: must hold whole numbers"),
    ("D(a, position=np.zeros((3, 3)))", "(position=...)`: shape (3, 3)"),
    ("D(a, valid=2)", "(valid=...)`: must hold true and false"),
    ("ix.fit(D(a), accel=ix.Invariant(gravity=1.0))", "(accel=...)`: gravity is 1"),
    ("ix.fit(D(a), gyro=ix.StaticGyro(gravity=9.81))", "(gyro=...)`: the dwells have no gyro"),
    ("ix.fit(D(gyro=w), gyro=ix.ReferenceGyro(gravity=9.81))", "no reference_gyro"),
    ("ix.fit(D(a), degree=9)", "(degree=9)`: must be from 0 to 6"),
    ("ix.fit(D(a), degree=1)", "temperature does not change"),
    ("ix.fit(D(a), accel=ix.StaticGyro(gravity=9.81))", "StaticGyro is no estimator for it"),
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
    ("State(np.eye(3), v + 1e5, np.array([0.9, 0.5, 0.0]))", "State(velocity=...)`"),
    ("with_coefficients(c, np.zeros(4))", "values have shape (4,), but the block has 3"),
    ("c.with_values('*.bias', np.zeros(2))", "values have shape (2,), but the block has 3"),
    ("c.block('gyro.bias')", "no coefficient is called that"),
    ("c.log_density(np.zeros(2))", "values have shape (2,)"),
    ("c.with_covariance(np.eye(2))", "shape (2, 2), but the calibration has 3"),
    ("c(x, x, 20.0)", "accel has shape (10, 3), but one sample has (3,)"),
    ("c.distort(v, x, 20.0)", "rate has shape (10, 3)"),
    ("triad.curve(np.zeros(1))", "takes one temperature but got shape (1,)"),
    ("ix.TriadCalibration(triad.curve, np.eye(3), names[:2], 'static')", "2 names"),
    ("ix.TriadCalibration(triad.curve, np.eye(2), names, 'static')", "(covariance=...)`: shape (2, 2)"),
    ("ix.Calibration(gravity=9.81, gyro=triad)", "(gyro=...)`: 'accel.bias[0]'"),
    ("ix.Curve(ix.Polynomial(2, 0.0, 1.0), np.zeros((2, 1)))", "3 functions"),
    ("ix.Polynomial(1, 70.0, -40.0)", "low < high"),
    ("ix.Twin(c, sample_rate=0.0)", "(sample_rate=...)`"),
    ("ix.Twin(c, delay=50.0)", "(delay=...)`"),
    ("ix.Twin(c, {'accel': {'N': 150.0}})", "accel N is 150"),
    ("ix.Twin(c, {'accel': {'X': 1e-3}})", "accel has no 'X'"),
    ("ix.Twin(c).step(ix.Twin(c).init(jax.random.PRNGKey(0), 20.0), x, v, 20.0)", "force has shape (10, 3)"),
    ("ix.stack([])", "nothing to stack"),
]  # fmt: skip

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
    ran = subprocess.run(
        [sys.executable, "-c", SETUP + RUN],
        input=json.dumps([case for case, _ in CASES]),
        env={**os.environ, "JAX_ENABLE_X64": "0"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = [json.loads(line) for line in ran.stdout.splitlines()]
    assert len(said) == len(CASES), ran.stderr[-2000:]
    wrong = [(c, s) for (c, words), s in zip(CASES, said) if words not in s or "\n" in s]
    assert not wrong
