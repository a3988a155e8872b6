"""Every form of every catalogued effect on either triad, with its number of coefficients."""

from collections.abc import Iterator

import numpy as np

from inertiax.effects import CATALOGUE, Effect, Signal, Variant


def signal(triad: str, degree: int, gain: float = 1.0) -> Signal:
    """A log with everything that an effect may need; `gain` multiplies what the triad feels."""
    num = 240
    rng = np.random.default_rng(0)
    time = np.arange(num) * 1.0
    force = rng.standard_normal((num, 3))
    rate = 0.5 * rng.standard_normal((num, 3))
    temperature = 20.0 + 15.0 * np.sin(time / 40.0)
    felt = force if triad == "accel" else rate
    return Signal(
        triad=triad, time=time, input=gain * felt, output=np.ones((num, 3)), since_power=time,
        since_start=time, since_move=time % 20.0, move=gain * np.roll(felt, 1, axis=0),
        at_rest=np.ones(num, bool), temperature=temperature,
        temperature_rate=np.gradient(temperature, time), force=force, rate=rate,
        room=np.broadcast_to(np.eye(3), (num, 3, 3)), vibration=rng.random(num),
        resolution=np.full(3, 0.1), scatter=np.full(3, 0.01), supply=5.0 + 0.1 * rng.standard_normal(num),
        at_temperature=lambda t: np.outer(t, [1.0, 2.0, 3.0]), degree=degree, low=5.0, high=35.0,
    )  # fmt: skip


def every_form() -> Iterator[tuple[Effect, str, Variant, int]]:
    """Effect, triad, form and number of columns; one form of those that differ in a nuisance setting alone."""
    for effect in CATALOGUE:
        for triad in effect.triads:
            known = set()
            for degree in (0, 3):
                log = signal(triad, degree)
                for variant in effect.variants(log):
                    apart = {k: v for k, v in variant.settings.items() if k != effect.nuisance}
                    key = repr(sorted(apart.items()))
                    if key not in known:
                        known.add(key)
                        columns = np.shape(effect.shape(log, **variant.settings))[2]
                        yield effect, triad, variant, columns
