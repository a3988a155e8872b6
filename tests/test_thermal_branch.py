"""An offset that has the sign of the temperature's rate: hysteresis whose branch turns where the temperature does."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.effects.moment import Moment
from inertiax.effects.thermal_hysteresis import EFFECT


SETTINGS = {"radius": 1e-3, "loop": "branch", "on": "bias"}


def moment(temperature: float, first: bool) -> Moment:
    """A sample at rest at a temperature, of an effect that was fitted from 0 to 40 °C."""
    still = np.zeros(3)
    return Moment(
        triad="accel", time=0.0, step=0.1, first=np.array(first), input=still, force=still, rate=still,
        temperature=temperature, at_rest=np.array(True), at_temperature=lambda t: still, coldest=0.0, warmest=40.0,
    )  # fmt: skip


def test_sample_by_sample_the_branch_is_that_of_the_diagnosis_once_a_turn_is_over():
    online = EFFECT.online
    assert online is not None
    course = 40.0 - 40.0 * np.abs(1.0 - np.arange(401) / 200.0)
    state, made = online.begin(SETTINGS, np.asarray(course[0])), []
    for k, temperature in enumerate(course):
        state, shape = online.follow(state, moment(temperature, k == 0), SETTINGS)
        made.append(float(np.asarray(shape)[0, 0]))
    # A turn is 0.08 °C wide and a sample's step 0.2: it shows in the first sample behind it.
    assert made[0] == 0.0 and set(made[1:201]) == {-1.0} and set(made[201:]) == {1.0}


def by_hand(seed: int, offset: float) -> Campaign:
    """64 rests of 4 s at random, with 1.5 s between them, over almost two turns of a temperature's sine."""
    rng = np.random.default_rng(seed)
    force = rng.standard_normal((64, 3))
    force *= 9.81 / np.linalg.norm(force, axis=1)[:, None]
    rows, turn = 200, 75
    resting = np.tile(np.arange(rows + turn) < rows, len(force))
    time = np.arange(len(resting)) / 50.0
    temperature = 30.0 + 20.0 * np.sin(2.0 * np.pi * time / 200.0)
    accel = np.repeat(force, rows + turn, axis=0) + np.array([0.1, -0.2, 0.05])
    accel += 4e-3 * (temperature - 30.0)[:, None] + 2e-3 * rng.standard_normal(accel.shape)
    accel[:, 0] += offset * np.sign(np.gradient(temperature))
    position = np.where(resting, np.repeat(np.arange(len(force)), rows + turn), -1)
    recording = Recording(time, accel=accel, temperature=temperature[:, None], position=position)
    return Campaign((recording,), Site(9.81), model=ModelChoice(temperature_degree=1))


@pytest.mark.slow
@pytest.mark.parametrize("seed, offset", [(1, 0.02), (2, 0.05), (3, -0.03)])
def test_an_offset_of_the_branch_is_named_and_measured(seed, offset):
    (found,) = diagnose(by_hand(seed, offset)).effects
    assert (found.name, found.channels) == ("thermal_hysteresis", ("accel_x",))
    size = dict(found.parameters)["coefficient"]
    assert abs(size.value + offset) < 4.0 * size.std


@pytest.mark.slow
def test_a_log_without_it_has_none():
    found = diagnose(by_hand(4, 0.0))
    assert found.verdict == "consistent"
