"""Dwell means in arrays to calibrations, for one device or many at once."""

import operator
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.labels import register_labelled
from ..calibration.stacking import unstack
from ..estimators import AbstractEstimator, GravityRotation, Invariant
from ..estimators.base import check_estimator
from ..physics.leaves import is_traced, own_object
from ..physics.temperature import AbstractBasis, Constant, Curve, Polynomial
from ..reduction.dwells import check_dwells, Dwells
from .rows import with_force
from .solve.batch import fit_fleet, FleetFit
from .solve.quarantine import judge


STANDARD_GRAVITY = 9.80665  # m/s², where none is given
LEAST_GRAVITY, GREATEST_GRAVITY = (
    9.5,
    10.1,
)  # m/s²: the Earth's is from 9.76 to 9.83, a sensor's own unit apart
# Condition of the coefficients' correlation, beyond which rounding decides: half the digits of 64 bits.
LARGEST_CONDITION = 1e8
HIGHEST_DEGREE = 6
FEW = 1000  # devices, whose solve takes far less than compiling
LEAST_STEP = 8  # dwells
SHOWN = 3  # reasons in a line that shows a fit


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What `fit` found; arrays lead with the axes of the dwells' devices.

    `succeeded` implies that the dwells determine every coefficient, that the solve converged, that no coefficient's
    standard deviation or misfit is beyond use, and that no scale factor is off by more than 10 % and no misalignment by
    more than 0.3 rad, which are a wrong unit, sign or axis; `reasons` says in a line why not.

    `residuals`, `chi2` and `dof` have an entry for each triad that was fitted. χ² weighs with the dwells' own sigma
    and is NaN where that was not given. Where it exceeds its expectation ν, made ν / (1 + 2/ν) for few residuals,
    `fit.accel.scatter` and `fit.gyro.scatter` are the further standard deviation between dwells that explains it
    (m/s², rad/s; zero where the noise suffices), and the covariance includes it. More than half of all fits have some
    by chance where sigma is right, so that the covariance is never less than sigma alone gives.
    """

    calibration: Calibration  # stacked where there are devices
    succeeded: Bool[np.ndarray, "*devices"]  # for each device
    dwells: Dwells  # that were fitted
    accel: AbstractEstimator | None  # with the scatter between dwells that was found
    gyro: AbstractEstimator | None  # with the scatter between dwells that was found
    reasons: tuple[str | None, ...] = ()  # of each device, devices flattened
    # SI, a row a dwell for `Invariant` (of |a|), three for the others; zero where a dwell was not used.
    residuals: Mapping[str, Float[np.ndarray, "*devices dwells rows"]] = field(default_factory=dict)
    # With the dwells' own sigma.
    chi2: Mapping[str, Float[np.ndarray, "*devices"]] = field(default_factory=dict)
    # Rows of the dwells that were used less coefficients.
    dof: Mapping[str, Int[np.ndarray, "*devices"]] = field(default_factory=dict)

    def __repr__(self) -> str:
        count = len(self.reasons)
        done = sum(r is None for r in self.reasons)
        estimators = [
            f"{k}={type(e).__name__}" for k, e in (("accel", self.accel), ("gyro", self.gyro)) if e
        ]
        parts = [f"{count} device{'s' * (count != 1)}, {done} succeeded", *estimators]
        failed = Counter(r for r in self.reasons if r is not None)
        parts += [f"{n} × {reason!r}" for reason, n in failed.most_common(SHOWN)]
        parts += [f"{len(failed) - SHOWN} other reasons"] if len(failed) > SHOWN else []
        return f"Fit({'; '.join(parts)})"


register_labelled(
    Fit,
    leaves=("calibration", "succeeded", "dwells", "accel", "gyro", "residuals", "chi2", "dof"),
    structure=(),
    labels={"reasons": ()},
)


def fit(
    dwells: Dwells,
    *,
    accel: AbstractEstimator | None = None,
    gyro: AbstractEstimator | None = None,
    degree: int = 0,
) -> Fit:
    """Calibrate the devices of `dwells`, whose leading axes are devices, in one batch.

    **Arguments:** `accel` and `gyro` are estimators (`Invariant(gravity=9.81)`, `ReferenceAccel()`,
    `ReferenceGyro(gravity=9.81)`, `StaticGyro(gravity=9.81)`, …); where neither is given the accelerometers are
    calibrated by `Invariant` with standard gravity. `degree` of all parameters' polynomials over temperature, 0 to 6;
    `Calibration.conditioned` takes slopes of some of them away again. Arithmetic is in 64 bits whatever JAX is set to.

    Dwells at a constant rate (`position` −1) are used by `ReferenceAccel` and `ReferenceGyro`; `Invariant`,
    `StaticAccel` and `StaticGyro` use rests only, as the command `calibrate` does.

    Raises `ValueError` for a triad or a temperature that the dwells lack, for estimators of two gravities, and in
    traced code: give `dwells` leading axes instead of `vmap`.
    """
    notes: tuple[str, ...] = ()
    if accel is None and gyro is None:
        accel = Invariant(gravity=STANDARD_GRAVITY)
        notes = (f"gravity was not given; {STANDARD_GRAVITY} m/s² is assumed",)
    check_dwells("fit(dwells)", dwells)
    _check(dwells, accel, gyro, degree)
    lead = dwells.valid.shape[:-1]
    flat = jax.tree.map(lambda x: np.asarray(x).reshape(-1, *np.shape(x)[len(lead) :]), dwells)
    flat, accel, gyro = jax.tree.map(own_object, (_padded(flat), accel, gyro))
    basis = _basis(flat, degree)
    with jax.enable_x64(True):
        triads, weights, seen = {}, {}, flat
        residuals, chi2, dof = {}, {}, {}
        reasons: list[str | None] = [None] * len(flat.valid)
        for estimator in (e for e in (accel, gyro) if e is not None):
            used = estimator.usable(seen)
            found = fit_fleet(estimator, basis, used)
            unread = np.asarray(seen.valid & ~used.valid).sum(axis=1)
            said = _reasons(estimator, basis, found, flat.temperature, unread)
            reasons = [first or second for first, second in zip(reasons, said, strict=True)]
            triads[estimator.triad] = _triad(estimator, basis, found)
            weights[estimator.triad] = found.scatter.reshape(lead)
            name, rows = estimator.triad, found.misfit.shape[2]
            left = rows * found.valid.sum(axis=1) - found.parameters.shape[1]
            misfit = np.where(found.valid[..., None], found.misfit, 0.0)
            misfit = misfit[:, : dwells.valid.shape[-1]]
            residuals[name] = misfit.reshape(*lead, *misfit.shape[1:])
            chi2[name] = (found.chi2_per_dof * left).reshape(lead)
            dof[name] = left.reshape(lead)
            if estimator is accel and gyro is not None:
                seen = with_force(estimator, basis, found, flat)
    stated = [getattr(e, "gravity", None) for e in (accel, gyro)]
    gravity = next((g for g in stated if g is not None), STANDARD_GRAVITY)
    many = Calibration(gravity=float(gravity), notes=notes).changed(
        gravity=np.full(len(flat.valid), float(gravity)), temperature_range=_range(flat), **triads
    )
    succeeded = np.array([r is None for r in reasons])
    one = not lead
    shaped = lambda tree: jax.tree.map(lambda x: np.reshape(x, (*lead, *np.shape(x)[1:])), tree)
    repeated = lambda e: None if e is None else _repeated(e, lead, weights[e.triad])
    calibration = unstack(many)[0] if one else shaped(many)
    return Fit(
        calibration,
        succeeded.reshape(lead),
        dwells,
        repeated(accel),
        repeated(gyro),
        tuple(reasons),
        residuals,
        chi2,
        dof,
    )


def _padded(dwells: Dwells) -> Dwells:
    """Few devices with dwells that are not valid, up to one of four numbers in an octave, each compiled once.

    Many devices compute for longer with more dwells than another program takes to compile.
    """
    devices, count = dwells.valid.shape
    step = max(LEAST_STEP, 2 ** (count.bit_length() - 3))
    more = -count % step if devices <= FEW else 0
    widened = jax.tree.map(
        lambda x: np.pad(x, [(0, 0), (0, more), *[(0, 0)] * (np.ndim(x) - 2)], mode="edge"), dwells
    )
    return eqx.tree_at(lambda d: d.valid, widened, np.pad(dwells.valid, [(0, 0), (0, more)]))


def _repeated(
    estimator: AbstractEstimator, lead: tuple[int, ...], scatter: np.ndarray
) -> AbstractEstimator:
    """An estimator for each device, with the scatter between dwells that was found."""
    repeat = lambda x: np.broadcast_to(np.asarray(x), (*lead, *np.shape(x)))
    return eqx.tree_at(lambda e: e.scatter, jax.tree.map(repeat, estimator), scatter)


def _check(
    dwells: Dwells, accel: AbstractEstimator | None, gyro: AbstractEstimator | None, degree: int
) -> None:
    if any(is_traced(x) for x in jax.tree.leaves(dwells)):
        raise ValueError(
            "`fit(dwells)`: does not work in traced code; give the dwells leading axes, which it fits in one batch."
        )
    _check_degree(degree)
    for triad, estimator in (("accel", accel), ("gyro", gyro)):
        if estimator is None:
            continue
        check_estimator(f"fit({triad}=...)", estimator)
        if isinstance(estimator, GravityRotation):
            raise ValueError(
                f"`fit({triad}=...)`: GravityRotation needs the motions between rests, which dwells do not hold; give "
                f"the recording: `from inertiax.calibrate.pipeline import calibrate`, "
                f"`calibrate(Campaign(recording, Site(gravity=...)))`."
            )
        if estimator.triad != triad:
            raise ValueError(
                f"`fit({triad}=...)`: {type(estimator).__name__} is no estimator for it."
            )
        if getattr(dwells, triad) is None:
            raise ValueError(f"`fit({triad}=...)`: the dwells have no {triad} outputs.")
        reference = f"reference_{triad}"
        if type(estimator).__name__.startswith("Reference") and getattr(dwells, reference) is None:
            raise ValueError(
                f"`fit({triad}={type(estimator).__name__}(...))`: the dwells have no {reference}."
            )
        stated = getattr(estimator, "gravity", STANDARD_GRAVITY)
        if np.shape(stated) != ():
            raise ValueError(
                f"`fit({triad}=...)`: gravity has shape {np.shape(stated)}; it is one number, so fit each place's "
                f"devices in a call of their own."
            )
        gravity = float(stated)
        if not LEAST_GRAVITY <= gravity <= GREATEST_GRAVITY:
            raise ValueError(
                f"`fit({triad}=...)`: gravity is {gravity:g}; it is in m/s², about 9.8 (in g?)."
            )
    _check_one_gravity(accel, gyro)
    if not degree:
        return
    probe = np.asarray(dwells.temperature)[np.asarray(dwells.valid)]
    if not np.any(probe):
        raise ValueError(
            f"`fit(degree={degree})`: the dwells have no temperature; give `Dwells.from_arrays(temperature=...)`."
        )
    if not np.ptp(probe) > 0.0:
        raise ValueError(f"`fit(degree={degree})`: the dwells' temperature does not change.")


def _check_one_gravity(accel: AbstractEstimator | None, gyro: AbstractEstimator | None) -> None:
    first, second = (getattr(e, "gravity", None) for e in (accel, gyro))
    # 32 bits of the same number differ by 6e-8 of it.
    if first is None or second is None or np.isclose(first, second, rtol=1e-6, atol=0.0):
        return
    raise ValueError(
        f"`fit(gyro=...)`: gravity is {float(second):g}, but that of accel is {float(first):g}; a device is calibrated "
        f"in one place, so give both the same."
    )


def _check_degree(degree: object) -> None:
    try:
        whole = operator.index(degree)  # pyright: ignore[reportArgumentType]
    except TypeError:
        raise ValueError(
            f"`fit(degree={degree!r})`: must be one whole number from 0 to {HIGHEST_DEGREE}, which all parameters "
            f"share; `Calibration.conditioned` takes slopes of some away again."
        ) from None
    if not 0 <= whole <= HIGHEST_DEGREE:
        raise ValueError(f"`fit(degree={degree})`: must be from 0 to {HIGHEST_DEGREE}.")


def _basis(dwells: Dwells, degree: int) -> AbstractBasis:
    if degree == 0:
        return Constant()
    probe = np.asarray(dwells.temperature)[np.asarray(dwells.valid)]
    return Polynomial(degree, float(probe.min()), float(probe.max()))


def _reasons(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    found: FleetFit,
    temperature: np.ndarray,
    unread: Int[np.ndarray, " devices"],
) -> list[str | None]:
    """`judge`, and dwells whose normal matrix is singular but for rounding; with the dwells that were no rests."""
    reasons = list(judge(estimator, basis, found, temperature))
    usable = np.flatnonzero(np.isfinite(found.covariance).all(axis=(1, 2)))
    spread = found.covariance[usable]
    scale = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.nan_to_num(spread / (scale[:, :, None] * scale[:, None, :]))
    # Of the accelerometers' or gyros' own coefficients, whose size cancels.
    smallest = np.linalg.eigvalsh(correlation)[:, 0]
    for k in usable[smallest * LARGEST_CONDITION < 1.0]:
        reasons[k] = reasons[k] or (
            f"{estimator.triad}: the dwells do not determine all {spread.shape[1]} coefficients; record more "
            f"positions{'' if basis.size == 1 else ' or temperatures'}"
        )
    name = type(estimator).__name__
    return [
        f"{said} ({name} uses rests only, not the {n} dwells of `position` -1)"
        if said and n
        else said
        for said, n in zip(reasons, unread.tolist(), strict=True)
    ]


def _triad(estimator: AbstractEstimator, basis: AbstractBasis, found: FleetFit) -> TriadCalibration:
    coefficients = found.parameters.reshape(len(found.parameters), basis.size, -1)
    many = jax.tree.map(lambda x: np.full(len(coefficients), float(x)), basis)
    name = {"Invariant": "invariant", "StaticAccel": "static", "StaticGyro": "static"}
    kind = name.get(type(estimator).__name__, "reference")
    return TriadCalibration(Curve(many, coefficients), found.covariance, estimator.names, kind)


def _range(dwells: Dwells) -> tuple[np.ndarray, np.ndarray] | None:
    probe, valid = np.asarray(dwells.temperature), np.asarray(dwells.valid)
    if not np.any(probe):
        return None
    low = np.where(valid, probe, np.inf).min(axis=1)
    return low, np.where(valid, probe, -np.inf).max(axis=1)
