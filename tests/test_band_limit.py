"""The sensor's low-pass filter is seen in the noise at rest, against SciPy's filters."""

import numpy as np
import pytest
import scipy.signal

from inertiax.data.recording import Campaign, Recording
from inertiax.plausibility import check_campaign
from inertiax.plausibility.band_limit import corner, HIGH, LOW


RATE = 200.0


def _log(noise: np.ndarray, *, repeats: int = 1) -> list:
    """Findings about two poses in which both triads have this noise."""
    noise = np.repeat(noise[: len(noise) // repeats], repeats, axis=0)
    count = len(noise)
    position = np.repeat([0, 1], [count // 2, count - count // 2])
    up = np.where(position[:, None] == 0, [0.0, 0.0, 9.81], [9.81, 0.0, 0.0])
    log = Recording(
        time=np.arange(count) / RATE,
        accel=up + 0.01 * noise,
        gyro=1e-3 * noise[:, ::-1],
        position=position,
        name="log",
    )
    return [f for f in check_campaign(Campaign((log,))).findings if f.kind == "band_limit"]


def _coefficients(kind: str, value: float) -> list:
    """Numerator and denominator of one pole, or of a second-order Butterworth filter."""
    if kind == "pole":
        return [[1.0 - value], [1.0, -value]]
    return list(scipy.signal.butter(2, value))  # pyright: ignore[reportArgumentType]


def _filtered(kind, value: float, seed: int, count: int = 16000) -> np.ndarray:
    white = np.random.default_rng(seed).normal(size=(count + 500, 3))
    made = scipy.signal.lfilter(*_coefficients(kind, value), white, axis=0)[500:]
    return made / made.std()


@pytest.mark.parametrize("pole", [0.3, 0.4, 0.5])
def test_the_corner_is_that_of_one_pole(pole):
    found = _log(_filtered("pole", pole, seed=1, count=64000))
    assert {f.what for f in found} == {"accel", "gyro"} and {f.severity for f in found} == {"note"}
    share = np.linspace(1e-4, 1.0, 20001)
    _, response = scipy.signal.freqz([1 - pole], [1, -pole], np.pi * share)
    down = share[np.argmax(np.abs(response) ** 2 < 0.5)]  # −3 dB
    # A quarter, as `DEEPEST` says: a thousand spectra give each axis a ratio known to 3 %.
    assert dict(found[0].evidence)["corner"] == pytest.approx(down * RATE / 2, rel=0.25)


@pytest.mark.parametrize(("kind", "value"), [("pole", 0.9), ("butter", 0.2), ("butter", 0.6)])
def test_deep_and_steep_filters_are_seen_and_have_no_corner(kind, value):
    found = _log(_filtered(kind, value, seed=1))
    assert {f.what for f in found} == {"accel", "gyro"}
    assert "corner" not in dict(found[0].evidence)


def test_the_ratio_of_one_pole_is_that_of_its_response():
    for pole in (0.2, 0.5, 0.65):
        _, response = scipy.signal.freqz([1 - pole], [1, -pole], np.pi * np.mean([LOW, HIGH], 1))
        place = corner(np.abs(response[0] / response[1]) ** 2)
        _, there = scipy.signal.freqz([1 - pole], [1, -pole], [np.pi * place])
        assert np.abs(there[0]) ** 2 == pytest.approx(0.5, abs=1e-9)


def test_white_noise_tremor_flicker_and_held_samples_are_no_filter():
    rng = np.random.default_rng(5)
    time = np.arange(16000) / RATE
    for seed in range(30):
        assert not _log(np.random.default_rng(seed).normal(size=(16000, 3)))
    white = rng.normal(size=(16000, 3))
    assert not _log(white + 5.0 * np.sin(2 * np.pi * 9.0 * time)[:, None])
    assert not _log(white + 0.02 * np.cumsum(rng.normal(size=(16000, 3)), axis=0))
    assert not _log(white, repeats=2)


def test_short_rests_tell_nothing():
    assert not _log(_filtered("pole", 0.8, seed=2, count=4000))
