"""When a fit is good: the one rule of the report's page, the JSON verdict and the fleet's quarantine.

Two questions, each with three answers. *Misfit*: is it what the dwells' noise predicts, more than that, or more than
any sensor's unmodelled effects leave? *Parameters*: is each one's sigma small against its value or usual size, not
small, or larger than the usual size, so that no calibration at all would be as good? And one with two. *Matrix*: can it
be a sensor's, or is it that of a wrong unit, sign or axis?
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from .._jax import eqx
from .._typing import AnyArray
from ..calibration.quantities import rms_text
from ..calibration.triad import slot


FINE, ATTENTION, UNUSABLE = 0, 1, 2  # grades, the worst last


@dataclass(frozen=True)
class FitLimits:
    """Limits of a good fit; origin beside each."""

    # Misfit over the dwells' noise from which it asks for an explanation. Below, the scatter between dwells is in the
    # uncertainties. Convention.
    noise_ratio: float = 3.0
    # Misfit over noise from which, beyond `gross_misfit`, the data contradict each other. Exchanged positions, a
    # duplicated block or two devices in one campaign leave 150 to 600; missing physics of the practice campaigns 8.
    gross_ratio: float = 100.0
    # Misfit over noise from which no requirement is decided: what is left is then no scatter that an uncertainty could
    # stand for. Missing physics of the practice campaigns leaves 8. Convention.
    undecided_ratio: float = 10.0
    # Twice what unmodelled effects of consumer sensors leave at rest: 0.2 mg/°C over 30 °C without a temperature
    # model have 1.7 mg rms; 0.1 °/s of g-sensitivity; half a degree of gravity's direction after a turn by hand.
    gross_misfit: Mapping[str, float] = field(
        default_factory=lambda: MappingProxyType({"m/s^2": 0.035, "rad/s": 0.0035, "rad": 0.017})
    )
    # What no calibration at all would leave, from `usual_size`: 0.1 m/s² and 1 % of g; 0.01 rad/s and 1 % of
    # 5 rad/s; 1 % of a half turn and 0.01 rad/s for 4 s.
    largest_misfit: Mapping[str, float] = field(
        default_factory=lambda: MappingProxyType({"m/s^2": 0.14, "rad/s": 0.05, "rad": 0.05})
    )
    # Errors of a consumer sensor as it is sold, SI, by data sheets of MPU-6050, BMI160 and LSM6DS3.
    usual_size: Mapping[str, float] = field(
        default_factory=lambda: MappingProxyType(
            {
                "accel.bias": 0.1,
                "accel.matrix": 1e-2,
                "gyro.bias": 1e-2,
                "gyro.matrix": 1e-2,
                "gyro.g_sensitivity": 1e-2,  # rad/s per g
            }
        )
    )
    # Sigma over the larger of value and usual size up to which it is small: three sigma. Convention.
    small: float = 1.0 / 3.0
    # Half angle of a cone without any orientation, degrees; six faces leave 55. Convention.
    empty_cone: float = 60.0
    # Stretch of the temperature range without any dwell, as a share of it. Convention.
    temperature_gap: float = 0.3
    motions: int = 12  # between rests, for the gyros' nine matrix elements. Convention.
    # A unit or a range is wrong: the widest tolerance of a data sheet is 10 % (ADXL335).
    wrong_scale: float = 0.1
    wrong_axis: float = 0.3  # rad; no misalignment inside a device is that large
    outlier: float = 5.0  # robust standard deviations of one dwell's misfit. Convention.


LIMITS = FitLimits()


class Finding(eqx.Module):
    """One thing that was looked at."""

    topic: str = eqx.field(static=True)  # misfit | orientations | rates | temperature | weakest | …
    grade: int = eqx.field(static=True)  # FINE, ATTENTION or UNUSABLE
    text: str = eqx.field(static=True)  # one sentence

    @property
    def fine(self) -> bool:
        """Whether nothing about it asks for attention."""
        return self.grade == FINE


def grade_misfit(
    unit: str,
    rms: Float[AnyArray, "*devices"] | float,
    noise_ratio: Float[AnyArray, "*devices"] | float,
    limits: FitLimits = LIMITS,
) -> Int[np.ndarray, "*devices"]:
    """Grades of misfits `rms` in `unit` (m/s^2, rad/s or rad), `noise_ratio` times the dwells' noise.

    The ratio is NaN where the noise is not known; a misfit that is no number is unusable.
    """
    rms, ratio = np.asarray(rms), np.asarray(noise_ratio)
    gross = (ratio > limits.gross_ratio) & (rms > limits.gross_misfit[unit])
    unusable = gross | ~(rms <= limits.largest_misfit[unit])
    return np.where(unusable, UNUSABLE, np.where(ratio >= limits.noise_ratio, ATTENTION, FINE))


def grade_parameters(
    names: tuple[str, ...],
    values: Float[AnyArray, "*batch parameters"],
    sigmas: Float[AnyArray, "*batch parameters"],
    limits: FitLimits = LIMITS,
) -> Int[np.ndarray, "*batch parameters"]:
    """Grades of parameters by their sigmas, SI. A sigma that is no number is unusable."""
    usual = np.array([usual_size(name, limits) for name in names])
    sigma = np.asarray(sigmas)
    size = np.maximum(np.abs(np.asarray(values)), usual)
    return np.where(
        ~(sigma <= usual), UNUSABLE, np.where(sigma > limits.small * size, ATTENTION, FINE)
    )


_TOLD = 3.0  # standard deviations, from which a value is more than its uncertainty


def grade_matrix(
    names: tuple[str, ...],
    values: Float[AnyArray, "*batch parameters"],
    limits: FitLimits = LIMITS,
) -> Int[np.ndarray, "*batch"]:
    """UNUSABLE where a scale factor or misalignment is larger than any sensor's, by a mistake; else FINE."""
    matrix = _matrix(names, np.asarray(values))
    diagonal = np.eye(3, dtype=bool)
    wrong = np.abs(matrix) > np.where(diagonal, limits.wrong_scale, limits.wrong_axis)
    return np.where(wrong.any(axis=(-2, -1)), UNUSABLE, FINE)


def matrix_mistakes(
    names: tuple[str, ...],
    values: Float[AnyArray, " parameters"],
    sigmas: Float[AnyArray, " parameters"],
    limits: FitLimits = LIMITS,
) -> list[tuple[str, str]]:
    """What makes `grade_matrix` UNUSABLE: topic (`frame`, `sign` or `unit`) and words, the most telling first.

    An element that the data hardly tell, which `grade_parameters` grades, is no mistake of anybody's.
    """
    values, sigmas = np.asarray(values), np.asarray(sigmas)
    matrix = _matrix(names, np.where(np.abs(values) < _TOLD * sigmas, 0.0, values))
    found: list[tuple[str, str]] = []
    for k, axis in enumerate("xyz"):
        times = 1.0 + float(matrix[k, k])
        # A swapped axis reads next to nothing of its own, of either sign.
        if -2.0 < times < -0.5:
            found.append(("sign", f"axis {axis} has the wrong sign."))
        elif abs(times - 1.0) > limits.wrong_scale:
            # By |a| = g alone the sign is not told, so that a fit may end at either.
            text = f"axis {axis} reads {abs(times):.3g} times the truth; look at unit and range."
            found.append(("unit", text))
    off = np.abs(matrix - np.diag(np.diagonal(matrix)))
    if off.max() > limits.wrong_axis and not any(topic == "sign" for topic, _ in found):
        i, j = np.unravel_index(int(np.argmax(off)), off.shape)
        text = f"axis {'xyz'[i]} reads much of axis {'xyz'[j]}; are axes swapped or turned?"
        found.insert(0, ("frame", text))
    return found


def _matrix(
    names: tuple[str, ...], values: Float[np.ndarray, "*batch parameters"]
) -> Float[np.ndarray, "*batch 3 3"]:
    """A triad's matrix from its parameters; zero where an element is none of them."""
    slots = np.zeros((*values.shape[:-1], 21))
    slots[..., [slot(n) for n in names]] = values
    return slots[..., 3:12].reshape(*values.shape[:-1], 3, 3)


def usual_size(name: str, limits: FitLimits = LIMITS) -> float:
    """The usual size of a parameter, SI, by its name, e.g. `accel.bias[0]`."""
    return limits.usual_size[name.partition("[")[0]]


def undecidable(unit: str, rms: float, noise_ratio: float) -> str | None:
    """In words why no requirement can be decided on parameters of such a misfit; `None` where it can.

    **Arguments:** as of `grade_misfit`, of one triad.
    """
    if int(grade_misfit(unit, rms, noise_ratio)) == UNUSABLE:
        return f"{rms_text(unit, rms)} rms is left, which no sound calibration leaves"
    if noise_ratio > LIMITS.undecided_ratio:
        return (
            f"{rms_text(unit, rms)} rms is left, {noise_ratio:.3g} times the noise, so that the model is wrong by more "
            "than its uncertainties can stand for; 'inertiax diagnose' looks for what it leaves out"
        )
    return None


FAR_BELOW = 0.4  # χ² per degree of freedom: the rig was stated as worse than it is (convention)


# Times the noise from which dwells are said to differ beyond it: χ² per degree of freedom of 1.56, which noise alone
# has in 7 % of fits with 15 degrees of freedom. The uncertainties include what there is from the start.
NOTICED = 1.25


def misfit_words(unit: str, rms: float, noise_ratio: float, scatter: float) -> str:
    """A misfit in words, with the cause to look for where it is unusable."""
    grade = int(grade_misfit(unit, rms, noise_ratio))
    text = f"{rms_text(unit, rms)} rms is left"
    if np.isnan(noise_ratio):
        text += "; the noise itself is not known, so that the misfit sets the uncertainties"
    elif scatter == 0.0 or noise_ratio < NOTICED:
        below = "far less than" if noise_ratio**2 < FAR_BELOW else "as"
        text += f", {below} noise and stated uncertainties predict (χ² per degree of freedom {noise_ratio**2:.2f})"
    else:
        text += f", {noise_ratio:.{1 if noise_ratio < 100 else 0}f} times the noise"
        text += f"; the uncertainties include the {rms_text(unit, scatter)} that dwells differ by"
    if grade == UNUSABLE:
        rows = ", rows that were lost" if unit == "rad" else ""  # of motions, which are integrated
        return (
            f"{text}. Look for wrong units, exchanged positions, a saturated axis{rows} or rests that "
            "are not at rest"
        )
    if grade == ATTENTION:
        return f"{text}. 'inertiax diagnose' looks for what the model leaves out"
    return text


def begun(text: str, case: Callable[[str], str]) -> str:
    """A sentence's first letter in that case, except that of a file's name."""
    word = text.partition(" ")[0].rstrip(":,")
    return case(text[0]) + text[1:] if word.isalpha() else text
