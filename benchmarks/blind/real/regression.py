"""An ordinary regression of a log's rests: the usual model, what is left of it, and how far an effect stands out.

Accelerometers in several poses: |M (a − b)| = g, nine parameters, by SciPy. Everything else: a constant (or the cubic
in temperature of a sweep) for each channel. The standard deviation is that of the residuals, so a log's own defects
count as its noise.
"""

import dataclasses

import effects
import numpy as np
import rests as rests_module
import scipy.stats
from scipy.optimize import least_squares


_CUBIC_FROM = 10.0  # °C of swing


@dataclasses.dataclass(frozen=True, eq=False)
class Baseline:
    """Residuals r ≈ (what an effect adds) · u, with the columns that the model's parameters can imitate."""

    residual: np.ndarray  # one a rest
    direction: np.ndarray  # (rest, 3): how much of an addition to each channel shows
    columns: np.ndarray  # (rest, parameter)
    sigma: np.ndarray  # of each residual
    one_channel: bool = False  # residuals of one channel in the order of time
    fit: np.ndarray | None = None  # bias (3) and lower triangle (6) of the invariant fit


def accel_by_gravity(r: rests_module.Rests, gravity: float) -> Baseline | None:
    """The invariant fit; `None` with fewer than three rests more than its nine parameters."""
    if len(r.time) < 12:
        return None
    lower = np.tril_indices(3)

    def shape(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        matrix = np.eye(3)
        matrix[lower] += x[3:]
        return matrix, (r.accel - x[:3]) @ matrix.T

    fun = lambda x: (np.linalg.norm(shape(x)[1], axis=1) - gravity) / noise
    noise = np.maximum(np.linalg.norm(r.accel_noise, axis=1) / np.sqrt(3.0), 1e-4)
    fit = least_squares(fun, np.zeros(9), method="lm")
    matrix, force = shape(fit.x)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    spread = np.sqrt(max(2 * fit.cost / (len(r.time) - 9), 1.0))
    return Baseline(
        fit.fun * noise, up @ matrix, fit.jac * noise[:, None], spread * noise, False, fit.x
    )


def drive(log, r: rests_module.Rests, moment: float) -> effects.Drive:
    """The drivers of every row, with the force by the invariant fit where the log has one."""
    base = None if log.one_pose else accel_by_gravity(r, log.gravity)
    if base is None or base.fit is None:
        return effects.drive(log, moment, log.accel / effects.G)
    matrix = np.eye(3)
    matrix[np.tril_indices(3)] += base.fit[3:]
    return effects.drive(log, moment, (log.accel - base.fit[:3]) @ matrix.T / effects.G)


def constant(values: np.ndarray, noise: np.ndarray, r: rests_module.Rests, axis: int) -> Baseline:
    """A bias, or a cubic in temperature, of one channel."""
    columns = [np.ones(len(values))]
    if r.temperature is not None and np.ptp(r.temperature) > _CUBIC_FROM:
        t = (r.temperature - r.temperature.mean()) / np.ptp(r.temperature)
        columns += [t, t**2, t**3]
    design = np.stack(columns, axis=1)
    noise = np.maximum(noise, np.median(noise))
    solution = np.linalg.lstsq(design / noise[:, None], values / noise, rcond=None)[0]
    residual = values - design @ solution
    spread = np.sqrt(max(np.sum((residual / noise) ** 2) / (len(values) - design.shape[1]), 1.0))
    spread *= _correlation_factor(residual / noise)
    direction = np.zeros((len(values), 3))
    direction[:, axis] = 1.0
    return Baseline(residual, direction, design, spread * noise, True)


def _correlation_factor(residual: np.ndarray) -> float:
    """√((1 + ρ)/(1 − ρ)) for residuals whose neighbours are correlated by ρ: what slow noise does to a slow effect."""
    neighbours = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    rho = min(max(neighbours, 0.0), 0.98)
    return float(np.sqrt((1 + rho) / (1 - rho)))


def baseline(log, r: rests_module.Rests, triad: str, axis: int) -> Baseline | None:
    """What `log` is judged against on one channel."""
    if triad == "accel" and not log.one_pose:
        return accel_by_gravity(r, log.gravity)
    values = (r.accel if triad == "accel" else r.gyro)[:, axis]
    noise = (r.accel_noise if triad == "accel" else r.gyro_noise)[:, axis]
    return constant(values, noise, r, axis) if len(values) >= 8 else None


def stands_out(base: Baseline, added: np.ndarray, axis: int) -> tuple[float, float, float]:
    """Size by regression, its standard deviation, and the latter of a size of one: σ of the estimate.

    The part of the effect that the model's parameters imitate is taken out first.
    """
    seen = base.direction[:, axis] * added / base.sigma
    columns = base.columns / base.sigma[:, None]
    left = seen - columns @ np.linalg.lstsq(columns, seen, rcond=None)[0]
    information = float(left @ left)
    if information <= 1e-12 * float(seen @ seen):
        return 0.0, np.inf, np.inf
    estimate = float(left @ (base.residual / base.sigma)) / information
    # With the effect in the model the residuals are smaller where it is there.
    rest = base.residual / base.sigma - left * estimate
    spread = np.sqrt(float(rest @ rest) / max(len(rest) - columns.shape[1] - 1, 1))
    spread *= _correlation_factor(rest) if base.one_channel else 1.0
    return estimate, spread / np.sqrt(information), 1.0 / np.sqrt(information)


def smallest(
    base: Baseline, added: np.ndarray, axis: int, rng: np.random.Generator, draws: int = 200
) -> float:
    """Standard deviation of an effect's estimated size in the log as it is.

    Where rows follow one another in one channel, noise of the residuals' own spectrum is drawn by turning the phases of
    its Fourier components: slow noise makes slow effects uncertain.
    """
    _, _, unit = stands_out(base, added, axis)
    if not base.one_channel or not np.isfinite(unit):
        return unit
    flat = dataclasses.replace(base, sigma=np.ones_like(base.sigma))
    spectrum = np.fft.rfft(base.residual)
    sizes = []
    for _ in range(draws):
        turned = spectrum * np.exp(2j * np.pi * rng.random(len(spectrum)))
        noise = np.fft.irfft(turned, n=len(base.residual))
        sizes.append(stands_out(dataclasses.replace(flat, residual=noise), added, axis)[0])
    return max(float(np.std(sizes)), unit / _correlation_factor(base.residual / base.sigma))


def whole(base: Baseline, columns: list[np.ndarray], axis: int) -> float:
    """By how many standard deviations several columns stand out together: Fisher's test as a normal deviate."""
    fixed = base.columns / base.sigma[:, None]
    off = lambda x: x - fixed @ np.linalg.lstsq(fixed, x, rcond=None)[0]
    seen = off(np.stack(columns, axis=1) * (base.direction[:, axis] / base.sigma)[:, None])
    y = base.residual / base.sigma
    solution, _, rank, _ = np.linalg.lstsq(seen, y, rcond=1e-6)
    left = y - seen @ solution
    freedom = len(y) - fixed.shape[1] - rank
    if rank == 0 or freedom < 1:
        return 0.0
    slow = (
        _correlation_factor(left) ** 2 if base.one_channel else 1.0
    )  # so many rows tell as much as one
    ratio = (y @ y - left @ left) / rank / (left @ left / freedom) / slow
    chance = max(float(scipy.stats.f.sf(ratio, rank, max(freedom / slow, 1.0))), 1e-300)
    return float(scipy.stats.norm.isf(0.5 * chance))


def all_effects(log, r: rests_module.Rests, triad: str) -> list[tuple[str, int, float, float]]:
    """(effect, axis, z, size) of everything on the menu, for the log as it is; steps at their best moment."""
    found, at_start = [], drive(log, r, 0.0)
    for axis in range(3):
        base = baseline(log, r, triad, axis)
        if base is None:
            continue
        for name, shape in effects.menu(log, triad).items():
            moments = r.time[1:-1] if name == "bias_step" else r.time[:1]
            best = (0.0, 0.0)
            for moment in moments:
                d = dataclasses.replace(at_start, moment=float(moment))
                size, sigma, _ = stands_out(base, effects.over_rests(d, shape, axis, r), axis)
                if np.isfinite(sigma) and abs(size / sigma) > abs(best[0]):
                    best = (size / sigma, size)
            found.append((name, axis, *best))
        swing = 0.0 if r.temperature is None else float(np.ptp(r.temperature))
        together = {} if log.one_pose else effects.WHOLE
        together = together | (effects.WHOLE_OF_TEMPERATURE if swing > _CUBIC_FROM else {})
        for name, shapes in together.items():
            columns = shapes(at_start, axis)
            means = [effects.means(c, r) for c in columns]
            found.append((name, axis, whole(base, means, axis), float("nan")))
    return found
