"""Every number of the first layer, computed once; `main` prints them in the precision JAX is set to.

A case names what it covers, `name` or `Class.name`; its function gives a pytree of numbers. What takes or gives no
numbers is in `WITHOUT_NUMBERS`.
"""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import inertiax as ix
from inertiax import navigation
from inertiax.allan.model import NoiseModel, NoiseTerm
from inertiax.navigation import strapdown
from inertiax.physics import rotation


# The departures that are allowed, relative to the largest number of a result. Numbers of the host, and what is
# computed in 64 bits whatever JAX is set to:
SAME = 1e-12
# A few dozen operations with rounding of 2⁻²⁴ = 6e-8 each, of inputs too:
ROUNDING = 2e-6
# Differences of numbers a hundred times larger (what is left of g after its size is taken away), and sums of
# hundreds of squares:
CANCELLATION = 2e-4
# Estimates of a filter, against their standard deviations, and these against themselves: a covariance is the
# difference of two that are up to a thousand times larger.
FILTERED = 1e-3
# Solutions whose normal equations were formed in 32 bits, relative to the parameters' standard deviations:
SOLVED = 0.05
# Statistics of 4000 draws, which are other draws in 32 bits: 5 standard deviations 1/√8000 of both.
DRAWN = 5.0 * 2.0**0.5 / 8000.0**0.5

GRAVITY = 9.81
ACCEL = tuple(f"accel.bias[{i}]" for i in range(3)) + ("accel.matrix[0,0]", "accel.matrix[1,0]")
GYRO = tuple(f"gyro.bias[{i}]" for i in range(3)) + ("gyro.matrix[0,1]", "gyro.g_sensitivity[2,0]")


@dataclass(frozen=True)
class Case:
    """Numbers of some names, and how far they may be off in 32 bits."""

    covers: tuple[str, ...]
    numbers: Callable[[], Any]
    tolerance: float


CASES: list[Case] = []


def case(*covers: str, tolerance: float) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Register a function of the table."""

    def register(numbers: Callable[[], Any]) -> Callable[[], Any]:
        CASES.append(Case(covers, numbers, tolerance))
        return numbers

    return register


# What the cases share -----------------------------------------------------------------------------


@cache
def made() -> SimpleNamespace:
    """A device, a plan and what it read, the same numbers in either precision."""
    random = np.random.default_rng(11)
    accel, gyro = (_triad(n, random) for n in (ACCEL, GYRO))
    device = ix.Calibration(
        GRAVITY, accel, gyro, device="SN 1", temperature_range=(-40.0, 70.0), notes=("a note",)
    )
    up = random.normal(size=(24, 3))
    up *= GRAVITY / np.linalg.norm(up, axis=1, keepdims=True)
    rate = random.normal(size=(24, 3))
    probe = np.tile([-30.0, 10.0, 60.0], 8)
    outputs = 1.001 * up + 0.02 + 1e-4 * random.normal(size=(24, 3))
    turned = 1.002 * rate + 1e-3 + 1e-6 * random.normal(size=(24, 3))
    dwells = ix.Dwells.from_arrays(
        outputs, turned, temperature=probe, experiment=np.tile([0, 1, 2], 8), sigma=(1e-4, 1e-6),
        reference_accel=up, reference_gyro=rate, position=np.arange(24),
    )  # fmt: skip
    sample = (np.array([0.3, -9.7, 0.8]), np.array([0.1, -0.2, 0.05]), np.float64(33.0))
    return SimpleNamespace(device=device, dwells=dwells, sample=sample, up=up, rate=rate)


def _triad(names: tuple[str, ...], random: np.random.Generator) -> ix.TriadCalibration:
    root = 1e-4 * random.standard_normal((15, 15))
    curve = ix.Curve(ix.Polynomial(2, -40.0, 70.0), 1e-2 * random.standard_normal((3, 5)))
    return ix.TriadCalibration(curve, root @ root.T, names, "reference")


@cache
def fitted() -> ix.Fit:
    """The plan's fit, with temperature."""
    estimators = {"accel": ix.Invariant(gravity=GRAVITY), "gyro": ix.ReferenceGyro(gravity=GRAVITY)}
    return ix.fit(made().dwells, **estimators, degree=1)


# Bases and curves ---------------------------------------------------------------------------------


def _basis(basis: Any) -> Any:
    at = [basis(t) for t in (-60.0, -40.0, 3.0, 70.0, 90.0)]
    return at, basis.rows(np.array([-60.0, 3.0])), list(basis.nodes), basis.at_nodes


for _name, _made in {
    "Constant": lambda: ix.Constant(),
    "Polynomial": lambda: ix.Polynomial(3, -40.0, 70.0),
    "CubicSpline": lambda: ix.CubicSpline((-40.0, -5.0, 20.0, 70.0)),
}.items():
    CASES.append(
        Case(
            (_name, *(f"{_name}.{m}" for m in ("__call__", "rows", "nodes", "at_nodes", "size"))),
            lambda made=_made: _basis(made()),
            ROUNDING,
        )
    )


@case("Curve", "Curve.__call__", tolerance=ROUNDING)
def _curve() -> Any:
    return [made().device.accel.curve(t) for t in (-40.0, 0.0, 55.0)]


# Equations (1) and (3) ----------------------------------------------------------------------------


@case(
    "AccelerometerErrors", "AccelerometerErrors.zero", "distort_accel", "compensate_accel",
    tolerance=ROUNDING,
)  # fmt: skip
def _accel_errors() -> Any:
    errors = ix.AccelerometerErrors(np.array([0.02, 0.0, -0.1]), 1e-2 * np.eye(3))
    force = made().sample[0]
    ideal = ix.distort_accel(ix.AccelerometerErrors.zero(), force)
    return ix.distort_accel(errors, force), ix.compensate_accel(errors, force), ideal


@case("GyroErrors", "GyroErrors.zero", "distort_gyro", "compensate_gyro", tolerance=ROUNDING)
def _gyro_errors() -> Any:
    errors = ix.GyroErrors(np.array([0.02, 0.0, -0.1]), 1e-2 * np.eye(3), 1e-4 * np.ones((3, 3)))
    force, rate, _ = made().sample
    both = [f(errors, rate, force, GRAVITY) for f in (ix.distort_gyro, ix.compensate_gyro)]
    return both, ix.distort_gyro(ix.GyroErrors.zero(), rate, force, GRAVITY)


# A calibration ------------------------------------------------------------------------------------


@case(
    "Calibration", "Calibration.__call__", "Calibration.distort", "Calibration.distort_by_parameters",
    "Calibration.accel_errors", "Calibration.gyro_errors", tolerance=ROUNDING,
)  # fmt: skip
def _calibration() -> Any:
    device, sample = made().device, made().sample
    there = [device.accel_errors(33.0), device.gyro_errors(33.0)]
    ways = device(*sample), device.distort(*sample), device.distort_by_parameters(*sample)
    return ways, jax.tree.leaves(there)


@case("FittedEffect", "FittedEffect.plain_settings", tolerance=ROUNDING)
def _effects() -> Any:
    effects = (
        ix.FittedEffect("second_order", "accel", (1,), (), np.array([2e-3]), np.eye(1), "m/s^2/g^2"),
        ix.FittedEffect(
            "dead_band", "gyro", (0,), (("width", 1e-3), ("form", "zone")), np.array([1e-3]), np.eye(1), "1"
        ),
    )  # fmt: skip
    device = made().device.changed(effects=effects)
    return (
        device(*made().sample),
        device.distort(*made().sample),
        effects[1].plain_settings["width"],
    )


@case("Calibration.extrapolates", tolerance=SAME)
def _extrapolates() -> Any:
    return [made().device.extrapolates(t) for t in (-40.5, -40.0, 70.0, 70.5)]


@case(
    "Calibration.coefficients", "Calibration.covariance", "Calibration.block", "Block",
    "Block.indices", "Calibration.with_values", "Calibration.with_covariance", "Calibration.changed",
    "Calibration.to_frame", "Calibration.triads", "Calibration.conditioned", tolerance=SAME,
)  # fmt: skip
def _coefficients() -> Any:
    device = made().device
    block = device.block("*.bias")
    moved = device.with_values(block, 2.0 * np.asarray(block.mean))
    wider = device.with_covariance(4.0 * np.asarray(device.covariance))
    table = device.to_frame([-40.0, 20.0]).select("value", "sigma").to_numpy()
    doubled = device.changed(gravity=2.0 * GRAVITY).gravity
    return (
        device.coefficients, device.covariance, block.mean, block.covariance, np.asarray(block.indices),
        moved.coefficients, wider.covariance, table, doubled, [t.covariance for t in device.triads],
        device.conditioned("*.misalignment").coefficients,
    )  # fmt: skip


@case("Calibration.summary", tolerance=SAME)
def _summary() -> Any:
    return np.frombuffer(made().device.summary().encode(), np.uint8).astype(float)


@case("Calibration.log_density", tolerance=CANCELLATION)
def _log_density() -> Any:
    device = made().device
    off = np.sqrt(np.diagonal(device.covariance)) * np.linspace(-1.0, 1.0, 30)
    return device.log_density(np.asarray(device.coefficients) + 1e-2 * off)


@case("Calibration.samples", tolerance=DRAWN)
def _samples() -> Any:
    device = made().device
    drawn = np.asarray(device.samples(jax.random.PRNGKey(0), 4000), float)
    sigma = np.sqrt(np.diagonal(device.covariance))
    return np.std(drawn, axis=0) / sigma


@case(
    "TriadCalibration", "TriadCalibration.parameters", "TriadCalibration.standard_deviations",
    tolerance=ROUNDING,
)  # fmt: skip
def _parameters() -> Any:
    triad = made().device.gyro
    return [(triad.parameters(t), triad.standard_deviations(t)) for t in (-40.0, 20.0, 70.0)]


@case("TriadCalibration.over", tolerance=SAME)
def _over() -> Any:
    return made().device.gyro.over(np.array([-40.0, 20.0]))


@case("stack", "unstack", tolerance=ROUNDING)
def _stack() -> Any:
    device = made().device
    many = ix.stack([device, device.with_values("*.bias", np.full(18, 0.01))])
    return jax.vmap(lambda c: c(*made().sample))(many), ix.unstack(many)[1].coefficients


@case("read_calibration", "write_calibration", tolerance=SAME)
def _file() -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        ix.write_calibration(made().device, path)
        back = ix.read_calibration(path)
    return back.coefficients, back.covariance, back.gravity, back.temperature_range


# Data ---------------------------------------------------------------------------------------------


def _log() -> ix.Recording:
    time = np.arange(600) * 0.01
    noise = 1e-3 * np.random.default_rng(3).normal(size=(600, 3))
    position = np.repeat([0, 1, 2], 200)
    return ix.Recording.from_arrays(
        time, made().up[position] + noise, temperature=20.0 + time, position=position
    )


@case(
    "Recording", "Recording.from_arrays", "Recording.from_frame", "Recording.num_samples",
    "Campaign", "Campaign.of_device", "Site", "Rig", tolerance=SAME,
)  # fmt: skip
def _recording() -> Any:
    table = {f"accel_{c}": made().up[:, k] for k, c in enumerate("xyz")}
    framed = ix.Recording.from_frame({"time": np.arange(24) * 1e-3, **table})
    campaign = ix.Campaign((_log(),), ix.Site(9.8, 0.9), ix.Rig(1e-5, 5e-6, 0.05))
    own = campaign.of_device("").recordings[0]
    site, rig = campaign.site, campaign.rig
    return framed.time, framed.accel, own.accel, own.temperature, own.num_samples, (
        site.gravity, site.latitude, rig.position_uncertainty, rig.rate_uncertainty,
    )  # fmt: skip


@case("load_campaign", tolerance=SAME)
def _campaign() -> Any:
    with tempfile.TemporaryDirectory() as folder:
        log = _log()
        rows = np.column_stack([log.time, log.accel])
        head = "time,accel_x,accel_y,accel_z"
        np.savetxt(Path(folder) / "log.csv", rows, delimiter=",", header=head, comments="")
        text = '[site]\ngravity = 9.81\nlatitude = 55.0\n[recordings]\nfiles = ["*.csv"]\n'
        (Path(folder) / "campaign.toml").write_text(text)
        read = ix.load_campaign(folder)
    return read.recordings[0].accel, read.recordings[0].time, read.site.latitude


@case("Dwells", "Dwells.from_arrays", "Dwells.num_dwells", "reduce_to_dwells", tolerance=SAME)
def _dwells() -> Any:
    found = ix.reduce_to_dwells([_log()])
    mine = [x for x in jax.tree.leaves(made().dwells) if np.asarray(x).dtype.kind == "f"]
    return mine, found.accel, found.accel_covariance, found.temperature, found.num_dwells


# Estimators and the procedure ---------------------------------------------------------------------

_ESTIMATORS = {
    "Invariant": lambda: ix.Invariant(gravity=GRAVITY),
    "ReferenceAccel": lambda: ix.ReferenceAccel(),
    "ReferenceGyro": lambda: ix.ReferenceGyro(gravity=GRAVITY),
    "StaticAccel": lambda: ix.StaticAccel(nominal=np.array([0.0, 0.0, GRAVITY])),
    "StaticGyro": lambda: ix.StaticGyro(gravity=GRAVITY),
}
_METHODS = ("compensate", "compose", "misfit", "pack", "residual", "start", "unpack", "usable")


def _estimator(estimator: Any) -> Any:
    """All of an estimator's formulas, at the parameters of a usual sensor; residuals in SI, as a misfit is, since a
    whitened one is that times 10⁴ and more."""
    vector = 1e-2 * np.cos(np.arange(estimator.num_parameters, dtype=float))
    dwell = made().dwells[3]
    refined = estimator.compensate(vector, dwell)
    misfit, sigma = estimator.misfit(vector, dwell)
    kept = refined.accel if estimator.triad == "accel" else refined.gyro
    again = estimator.pack(estimator.unpack(vector))
    size = GRAVITY if estimator.triad == "accel" else 1.0
    residual = np.asarray(estimator.residual(vector, dwell), float) * np.asarray(sigma, float)
    used = estimator.usable(made().dwells).valid
    beside = lambda x: np.append(np.asarray(x, float), size)  # rounding is that of the outputs
    return (
        kept, estimator.compose(vector, 0.1 * vector), beside(misfit), beside(residual), sigma, again,
        beside(estimator.start(made().dwells)), used,
    )  # fmt: skip


for _name, _made in _ESTIMATORS.items():
    # Closed-form starts invert normal equations of outputs that vary by some hundreds of roundings' worth.
    CASES.append(
        Case(
            (_name, *(f"{_name}.{m}" for m in _METHODS), f"{_name}.num_parameters"),
            lambda made=_made: _estimator(made()),
            CANCELLATION,
        )
    )


def _in_sigmas(coefficients: Any) -> Any:
    """Coefficients of the accelerometers' fit in standard deviations of its answer."""
    answer = _answer()
    sigma = np.sqrt(np.diagonal(answer.covariance)).reshape(np.shape(answer.curve.coefficients))
    off = np.asarray(coefficients, float) - np.asarray(answer.curve.coefficients, float)
    return np.append(off / sigma, 1.0)


@cache
def _answer() -> Any:
    with jax.enable_x64(True):
        found = ix.joint_fit(ix.Invariant(gravity=GRAVITY), ix.Polynomial(1, -30.0, 60.0), _rests())
    return jax.tree.map(np.asarray, found)


def _rests() -> ix.Dwells:
    own = made().dwells
    return ix.Dwells.from_arrays(
        own.accel, temperature=own.temperature, experiment=own.experiment, sigma=1e-2
    )


@case("iterate", "joint_fit", tolerance=SAME)
def _solved() -> Any:
    estimator, basis = ix.Invariant(gravity=GRAVITY), ix.Polynomial(1, -30.0, 60.0)
    by_passes = ix.iterate(ix.GaussNewtonIteration(estimator, basis), _rests())
    at_once = ix.joint_fit(estimator, basis, _rests())
    assert by_passes.succeeded and at_once.succeeded
    return [(s.curve.coefficients, s.covariance) for s in (by_passes, at_once)]


@case("PaperIteration", "PaperIteration.plan", "PaperIteration.refine", "PaperIteration.experiments",
      "GaussNewtonIteration", "GaussNewtonIteration.refine", tolerance=SOLVED)  # fmt: skip
def _passes() -> Any:
    estimator, basis = ix.Invariant(gravity=GRAVITY), ix.Polynomial(1, -30.0, 60.0)
    start = _answer().curve.coefficients
    paper = ix.PaperIteration.plan(estimator, basis, _rests())
    own = ix.GaussNewtonIteration(estimator, basis)

    @jax.jit
    def run(start: Any, dwells: ix.Dwells) -> Any:
        temperature, _ = paper.experiments(start, dwells)
        return temperature, [p.refine(start, dwells) for p in (paper, own)]

    temperature, after = run(start, _rests())
    return temperature, [_in_sigmas(a) for a in after]


@case("fit", "Fit", tolerance=SAME)
def _fit() -> Any:
    found = fitted()
    return found.calibration.coefficients, found.calibration.covariance, found.succeeded


@case(
    "derivatives", "Derivatives", "Derivatives.sigma", "Derivatives.covariance", tolerance=ROUNDING
)
def _derivatives() -> Any:
    table = ix.derivatives(fitted(), [ix.sources.gravity(1e-4), ix.sources.output_noise()])
    return table.by_source, table.sigma, table.covariance("reference g")


def _all_sources() -> dict[str, Any]:
    axes = ix.sources.table_axes(np.tile(np.eye(3), (24, 1, 1)), np.eye(3)[0], np.eye(3)[2])
    own = ix.sources
    return {
        "output_noise": own.output_noise(), "repositioning": own.repositioning(1e-4),
        "day_to_day": own.day_to_day(1e-4), "probe_noise": own.probe_noise(0.1),
        "probe_offset": own.probe_offset(0.1), "timing": own.timing(1.0),
        "gravity": own.gravity(1e-4), "table_angles": own.table_angles(1e-5, *axes),
        "positioning": own.positioning(1e-5), "mounting": own.mounting(1e-5),
        "table_rate": own.table_rate(1e-5),
    }  # fmt: skip


@case(
    "sources.table_axes", "sources.Source", "sources.Scene", "sources.Disturbance",
    *(f"sources.{n}" for n in (
        "output_noise", "repositioning", "day_to_day", "probe_noise", "probe_offset", "timing", "gravity",
        "table_angles", "positioning", "mounting", "table_rate",
    )), tolerance=ROUNDING,
)  # fmt: skip
def _sources() -> Any:
    dwells = made().dwells
    scene = ix.sources.Scene(made().up, made().rate, np.linspace(-1e-3, 1e-3, 24))
    count = dwells.num_dwells
    values = lambda s: s.size * np.sin(np.arange(count * s.width, dtype=float)).reshape(count, -1)
    found = {n: s.effect(jnp.asarray(values(s)), scene, dwells) for n, s in _all_sources().items()}
    # A small turn's effect is the difference of two vectors: rounding is that of the vector, per 1e-5 of it.
    small = lambda n, x: np.append(x, GRAVITY) if n in _TURNING else x
    return [small(n, x) for n in found for x in jax.tree.leaves(found[n])]


_TURNING = ("table_angles", "positioning", "mounting")


# A twin -------------------------------------------------------------------------------------------


@case("Twin", "Twin.init", "Twin.step", "TwinState", tolerance=ROUNDING)
def _twin() -> Any:
    noise = {"accel": {"R": 1e-3, "full_scale": 40.0}}
    effect = ix.FittedEffect(
        "thermal_lag", "accel", (0,), (("time_constant", 3.0),), np.array([1.0]), np.eye(1), "1"
    )
    twin = ix.Twin(made().device.changed(effects=(effect,)), noise, sample_rate=10.0, delay=0.25)
    samples = made().up, made().rate, np.linspace(10.0, 12.0, 24)

    @jax.jit
    def run(twin: ix.Twin) -> Any:
        start = twin.init(jax.random.PRNGKey(0), 10.0)
        return jax.lax.scan(lambda s, x: twin.step(s, *x), start, samples)[1]

    return run(twin)


@case("Twin.step with noise", tolerance=CANCELLATION)
def _noisy() -> Any:
    """All terms at once: the numbers that are drawn are the same in either precision."""
    noise = {"N": [1e-3, 0.0, 0.0], "Q": [0.0, 1e-4, 0.0], "K": [0.0, 0.0, 1e-3], "B": 1e-4}
    twin = ix.Twin(ix.Calibration(GRAVITY), {"accel": noise}, sample_rate=50.0)
    still = jnp.zeros(3)

    @jax.jit
    def run(twin: ix.Twin) -> Any:
        start = twin.init(jax.random.PRNGKey(2), 20.0)
        step = lambda s, _: twin.step(s, still, still, 20.0)
        return jax.lax.scan(step, start, None, length=4000)[1][0]

    return list(run(twin).T)


@case("Twin.draw", tolerance=DRAWN)
def _drawn() -> Any:
    model = SimpleNamespace(degree=0, low=0.0, high=1.0, names=ACCEL, estimator="invariant")
    spread = np.diag(np.array([1e-2, 2e-2, 3e-2, 1e-4, 1e-4]) ** 2)
    accel = SimpleNamespace(model=model, mean=np.full(5, 1e-3), prior_covariance=spread)
    population = SimpleNamespace(accel=accel, gyro=None)
    one = lambda key: ix.Twin.draw(key, population).calibration.coefficients
    drawn = np.asarray(jax.vmap(one)(jax.random.split(jax.random.PRNGKey(1), 4000)), float)
    return np.std(drawn, axis=0) / np.sqrt(np.diagonal(spread))


# Navigation ---------------------------------------------------------------------------------------

LATITUDE, HEIGHT = 0.9599, 200.0


def _path(t: Any) -> Any:
    """600 m in a minute, on a heading that changes."""
    heading = 0.4 + 0.3 * jnp.sin(0.02 * t)
    velocity = 10.0 * jnp.stack([jnp.sin(heading), jnp.cos(heading), jnp.zeros_like(t)])
    attitude = rotation.about(jnp.array([0.0, 0.0, 1.0]), -heading)
    return velocity, attitude @ rotation.about(jnp.array([0.0, 1.0, 0.0]), 0.1 * jnp.sin(0.02 * t))


def gone(rate: int) -> Any:
    """Where a navigator is after 600 m at a sample rate (Hz), and where it should be: m, east, north, up."""
    start = jnp.array([LATITUDE, 0.5, HEIGHT])
    count, step = 60 * rate, jnp.asarray(1.0 / rate)

    @jax.jit
    def run(start: Any, step: Any) -> Any:
        force, turning, first, truth = strapdown.ideal_data(_path, start, count, step)
        data = navigation.ImuData(force, turning, jnp.full(count, 20.0), step)
        states = strapdown.navigate(lambda a, w, t: (a, w), data, first)
        return states.position[-1], truth.position[-1]

    return run(start, step)


RATES = (1, 50, 400)  # Hz


for _rate in RATES:
    # 0.1 m in 600: what a user of 32 bits is promised.
    CASES.append(Case((f"600 m at {_rate} Hz",), lambda rate=_rate: gone(rate), 0.1 / 600.0))


@cache
def _frame() -> navigation.LevelFrame:
    return navigation.LevelFrame(LATITUDE, HEIGHT)


@case(
    "navigation.LevelFrame", "navigation.LevelFrame.earth_rate", "navigation.LevelFrame.gravity_at",
    "navigation.LevelFrame.gravity_gradient", tolerance=ROUNDING,
)  # fmt: skip
def _level() -> Any:
    frame, away = _frame(), jnp.array([3e3, -2e3, 100.0])
    return frame.earth_rate(away), frame.gravity_at(away), frame.gravity_gradient(away)


@case("navigation.ExtendedPose", "navigation.ExtendedPose.matrix", tolerance=ROUNDING)
def _pose() -> Any:
    return navigation.ExtendedPose(np.eye(3), np.array([1.0, 2.0, 3.0]), np.ones(3)).matrix()


@cache
def _noise() -> navigation.ImuNoise:
    accel = navigation.TriadNoise(white=6e-4, flicker=1e-4, walk=2e-5)
    return navigation.ImuNoise(accel, navigation.TriadNoise(white=4e-5, walk=1e-6))


@case(
    "navigation.ImuNoise", "navigation.ImuNoise.correlation_times", "navigation.ImuNoise.count",
    "navigation.TriadNoise", "navigation.TriadNoise.from_models", tolerance=SAME,
)  # fmt: skip
def _noises() -> Any:
    known = (("N", 1e-3), ("B", None), ("K", 2e-5))
    terms = {k: NoiseTerm(v, None, 0.0, np.inf) for k, v in known}
    model = NoiseModel("accel", 100.0, 1000.0, terms, chi2_per_dof=1.0, band=(0.1, 50.0))
    found = navigation.TriadNoise.from_models([model] * 3)
    return _noise().correlation_times[1:], _noise().count, found.white, found.flicker, found.walk


@cache
def _ran() -> SimpleNamespace:
    """A device that is wobbled for eight seconds, with fixes."""
    device = made().device.with_covariance(np.diag([1e-6] * 15 + [1e-8] * 15))
    filter_ = navigation.Filter(device, "*.bias", noise=_noise(), frame=_frame(), samples=10)
    with jax.enable_x64(True):
        pull = np.asarray(_frame().gravity_at(jnp.zeros(3)))
        still = np.asarray(_frame().earth_rate(jnp.zeros(3)))
        accel, gyro = (np.asarray(x) for x in device.distort(-pull, still, 20.0))
    wobble = 1e-2 * np.sin(np.arange(80)[:, None] * np.array([0.3, 0.7, 1.1]))
    outputs = (accel + wobble, gyro + 1e-2 * wobble, np.linspace(18.0, 22.0, 80))
    precise = jnp.result_type(float)
    data = navigation.ImuData(*(jnp.asarray(x, precise) for x in outputs), jnp.asarray(0.1))
    start = filter_.start(
        np.eye(3), np.zeros(3), jnp.zeros(3), attitude_sigma=2e-3, velocity_sigma=0.05, position_sigma=0.5
    )  # fmt: skip
    index, valid = navigation.on_segments(np.arange(1.0, 9.0), filter_.ends(data), tolerance=1e-6)
    fixes = np.array([[0.02, -0.01, 0.03]] * 8)[index]
    updates = [
        navigation.Position(fixes, 0.1, valid),
        navigation.zero_velocity(np.ones(8, bool), 0.02),
        navigation.Attitude(np.tile(np.eye(3), (8, 1, 1)), 1e-2),
    ]
    run = jax.jit(lambda f, *given: f.run(*given))
    track = run(filter_, start, data, updates)
    return SimpleNamespace(filter=filter_, data=data, start=start, track=track, updates=updates)


def _pose_in_sigmas(estimate: navigation.Estimate, sigma: Any) -> Any:
    """Velocity and position in standard deviations: an estimate is not known better."""
    pose, own = estimate.navigation, np.asarray(sigma, float)
    return [
        np.append(np.asarray(x, float) / own[:, k : k + 3], np.ones((8, 1)))
        for x, k in ((pose.velocity, 3), (pose.position, 6))
    ]


@case(
    "navigation.Filter", "navigation.Filter.start", "navigation.Filter.run", "navigation.Filter.ends",
    "navigation.Track", "navigation.Track.covariance", "navigation.Track.sigma", "navigation.ImuData",
    "navigation.Estimate", "navigation.FilterState", "navigation.on_segments", "navigation.Position",
    "navigation.zero_velocity", "navigation.Attitude", "navigation.Velocity", tolerance=FILTERED,
)  # fmt: skip
def _filtered() -> Any:
    track, first = _ran().track, _ran().start
    diagonal = np.diagonal(np.asarray(first.covariance, float))
    estimate = track.estimate
    return (
        track.sigma, _pose_in_sigmas(estimate, track.sigma), estimate.calibration, diagonal,
        _ran().filter.ends(_ran().data), estimate.navigation.attitude,
    )  # fmt: skip


@case(
    *(f"navigation.{c}.{m}" for c in ("Position", "Velocity", "Attitude", "Residual") for m in ("residual", "neutral")),
    "navigation.Residual", tolerance=ROUNDING,
)  # fmt: skip
def _residuals() -> Any:
    one = jax.tree.map(lambda x: x[0], _ran().track.estimate)
    far = jnp.array([100.0, 20.0, 3.0])
    level = rotation.exp(jnp.array([0.1, 0.2, 0.3]))
    function = lambda estimate, value: value - estimate.navigation.position[:1]
    every = [
        (navigation.Position(far[None], 0.1), far),
        (navigation.Velocity(far[None], 0.1), far),
        (navigation.Attitude(level[None], 0.1), level),
        (navigation.Residual(function, far[None, :1], 0.1), far[:1]),
    ]
    return [(u.residual(one, value), u.neutral) for u, value in every]


@case("navigation.smooth", "navigation.Smoothed", "navigation.Smoothed.sigma", tolerance=FILTERED)
def _smoothed() -> Any:
    found = navigation.smooth(_ran().track)
    return found.sigma, _pose_in_sigmas(found.estimate, found.sigma)


@case("navigation.coefficient_covariance", "navigation.refined", tolerance=FILTERED)
def _refined() -> Any:
    last = _ran().track.last
    refined = navigation.refined(_ran().filter, last)
    spread = np.asarray(navigation.coefficient_covariance(_ran().filter, last), float)
    return np.sqrt(np.diagonal(spread)), refined.coefficients, np.diagonal(refined.covariance)


@case("navigation.observability", "navigation.Observability", tolerance=FILTERED)
def _shown() -> Any:
    found = navigation.observability(_ran().filter, _ran().track)
    return found.reduction, found.share


# What takes and gives no numbers: text, choices, structure.
WITHOUT_NUMBERS = {
    "ModelChoice", "Campaign.devices", "Campaign.reservations", "FittedEffect.channel_names",
    "Calibration.coefficient_names",
    "Calibration.coefficient_units", "Calibration.without_effects", "Calibration.plot",
    *(f"{e}.names" for e in _ESTIMATORS), "navigation.Filter.names", "navigation.Observability.parameters",
    "navigation.Observability.statement", "sources.Disturbance.touches",
    *(f"navigation.{u}.navigation_only" for u in ("Position", "Velocity", "Attitude", "Residual")),
}  # fmt: skip


def numbers_of(result: Any) -> list[list[float]]:
    """Leaves of a result."""
    return [np.asarray(x, float).ravel().tolist() for x in jax.tree.leaves(result)]


def main() -> None:
    """One line of JSON a case: its numbers, or the error."""
    for shared in (made, fitted, _answer, _frame, _noise, _ran):
        shared.cache_clear()
    for one in CASES:
        try:
            line: Any = numbers_of(one.numbers())
        except Exception as error:  # which is what the table is about
            line = f"{type(error).__name__}: {error}"
        print(json.dumps(line), flush=True)
