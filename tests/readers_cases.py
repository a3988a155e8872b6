"""A made-up recording, and what every reader's test asks of it."""

import numpy as np
import pytest

from inertiax.data.campaign import load_campaign


RATE, COUNT = 200.0, 400


def made_up(seed=0, count=COUNT):
    """time (s), accel (m/s²), gyro (rad/s), temperature (°C) of a device that stands and trembles."""
    rng = np.random.default_rng(seed)
    return {
        "time": 10.0 + np.arange(count) / RATE,
        "accel": [0.1, -0.2, 9.8] + 0.01 * rng.standard_normal((count, 3)),
        "gyro": 0.001 * rng.standard_normal((count, 3)),
        "temperature": 25.0 + 0.01 * np.arange(count),
    }


def campaign(folder, files, extra=""):
    """The recordings that a campaign of these files reads."""
    (folder / "campaign.toml").write_text(
        f"[site]\ngravity = 9.81\n[recordings]\nfiles = {files!r}\n{extra}\n".replace("'", '"')
    )
    return load_campaign(folder).recordings


def check(recording, data, *, rtol=1e-15, time_atol=0.0):
    """The recording holds the data; float32 formats have rtol 6e-8."""
    np.testing.assert_allclose(recording.time, data["time"], rtol=1e-15, atol=time_atol)
    np.testing.assert_allclose(recording.accel, data["accel"], rtol=rtol)
    np.testing.assert_allclose(recording.gyro, data["gyro"], rtol=rtol)
    if data.get("temperature") is None:
        assert recording.temperature is None
    else:
        np.testing.assert_allclose(recording.temperature[:, 0], data["temperature"], rtol=rtol)


def refusal(read, *arguments, **settings):
    """The one line in which a call refuses."""
    with pytest.raises(ValueError) as caught:
        read(*arguments, **settings)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 500
    return message
