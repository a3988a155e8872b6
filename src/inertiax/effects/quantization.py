"""Quantisation coarser than the noise."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import any_grade, Effect
from .signal import Signal


HARMONICS = 6


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """Mean rounding error of an output x with step q and Gaussian scatter s, m/s² or rad/s.

    $(q/\\pi) \\sum_k (-1)^k/k \\, \\sin(2\\pi k x/q) \\, e^{-2 (\\pi k s/q)^2}$
    (Widrow & Kollár, Quantization Noise, 2008). A recorded output is rounded already, a whole number of steps, and
    says nothing of what was lost: there the value is the one that the fitted model expects.
    """
    q, s = xp.asarray(signal.resolution)[None, :], xp.asarray(signal.scatter)[None, :]
    x = xp.asarray(signal.output if signal.expected is None else signal.expected)
    error = xp.zeros_like(x)
    for k in range(1, HARMONICS + 1):
        left = xp.exp(-2.0 * (xp.pi * k * s / q) ** 2)
        if not xp.of_jax(left, x) and not left.any():
            break  # steps far below the scatter leave nothing, of higher harmonics even less
        error = error + (-1.0) ** k / k * xp.sin(2.0 * xp.pi * k * x / q) * left
    return (error * q / xp.pi)[:, :, None]


EFFECT = Effect(
    name="quantization",
    title="quantisation (IEEE 952)",
    equation="q round(x / q) - x",
    units={"accel": "1", "gyro": "1"},
    prior={"accel": any_grade(0.3, 1.5), "gyro": any_grade(0.3, 1.5)},
    shape=shape,
    in_numpy=True,
    needs="noise below half a step of the outputs",
    driver="output",
    sentence="The output of {channels} is quantised more coarsely than its noise.",
    separating="dither, or steps of input below one step of output",
    requires=("resolution", "scatter"),
    unit_amplitude=True,
    once=True,
    lost="rounding cannot be undone",
)
