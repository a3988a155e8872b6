"""A part of a bias' temperature dependence that lags, beside a part that does not."""

import jax
import numpy as np
import pytest

import hand_log_data
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.estimates.augmented_calibration import Beside
from inertiax.diagnose.late_elements import Chain
from inertiax.diagnose.partial_lag import _fit, _pays, with_part_late
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.result import Diagnosis
from inertiax.effects.effect import Variant


GRAVITY = 9.81
SLOPE = 4e-3  # m/s²/°C


def lagged(time, temperature, constant):
    """First order by exact steps of a temperature that is straight between rows."""
    made, decay = np.empty_like(temperature), np.exp(-np.diff(time) / constant)
    made[0] = temperature[0]
    for k, d in enumerate(decay):
        slope = (temperature[k + 1] - temperature[k]) / (time[k + 1] - time[k])
        start = made[k] - (temperature[k] - slope * constant)
        made[k + 1] = temperature[k + 1] - slope * constant + start * d
    return made


def test_the_late_slope_and_its_error_are_those_of_the_rows():
    rng = np.random.default_rng(3)
    rows = 120
    time = np.linspace(0.0, 6000.0, rows)
    probe = np.interp(time, [0.0, 2000.0, 4000.0, 6000.0], [0.0, 40.0, 40.0, 0.0])
    up = rng.uniform(-1.0, 1.0, rows)
    behind = lagged(time, probe, 300.0) - probe
    basis = np.polynomial.chebyshev.chebvander(probe / 20.0 - 1.0, 1)
    jacobian = np.stack([np.ones(rows), up], axis=1)
    slopes, stated = [], []
    for _ in range(100):
        output = 0.1 + 1e-3 * probe + up * (9.81 + 1e-3 * probe) + SLOPE * behind
        output = output + 1e-3 * rng.standard_normal(rows)
        chain = Chain(output, jacobian, jacobian[:, :1], ("accel.bias[0]", "accel.matrix[0,0]"))
        late, plain = _fit(chain, basis, behind), _fit(chain, basis, np.zeros((rows, 0)))
        slopes.append(late.slope[0])
        stated.append(late.std[0])
        assert _pays(plain, late, rows) and not _pays(late, plain, rows)
    assert abs(np.mean(slopes) - SLOPE) < 5.0 * np.std(slopes) / 10.0
    assert (
        0.7 < np.mean(stated) / np.std(slopes) < 1.4
    )  # 100 repetitions know a scatter to 7 %; four of that


def heated(share, constant=300.0):
    """Rests in 18 positions while the chamber goes up and down; of the bias of y that share of the slope is late."""
    rng = np.random.default_rng(80)
    ups = [
        v
        for v in np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3)
        if 0 < np.abs(v).sum() < 3
    ]
    rest, rows = 30, []
    for number, up in enumerate(ups * 6):
        rows += [(*(GRAVITY * up / np.linalg.norm(up)), number % len(ups))] * rest + [
            (0.0, 0.0, GRAVITY, -1)
        ] * 5
    rows = np.array(rows)
    time = np.arange(len(rows)) / 2.0
    probe = np.interp(time / time[-1], np.arange(7) / 6.0, [0, 20, 40, 40, 20, 0, 0])
    element = lagged(time, probe, constant)
    force = rows[:, :3]
    accel = force * (1.0 + 1e-3 + 5e-5 * (probe - 20.0))[:, None] + 0.05
    accel[:, 1] += SLOPE * ((1.0 - share) * probe + share * element)
    recording = Recording(
        time=time, accel=accel + 2e-3 * rng.standard_normal(accel.shape), reference_accel=force,
        temperature=probe[:, None], position=rows[:, 3].astype(int),
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference", temperature_degree=1)
    return Campaign((recording,), Site(GRAVITY), model=model)


@pytest.mark.slow
def test_a_late_part_is_measured_in_words_where_no_lag_of_all_is_named():
    with jax.enable_x64(True):
        found = diagnose(heated(0.5))
    (said,) = [n for n in found.notes if "follows the probe with a lag of" in n]
    assert "bias of accel_y" in said and said in found.summary
    slope, _, error = said.split("accel_y, ")[1].split(" mg/°C")[0].split()
    tau, _, width = said.split("a lag of ")[1].split(" s,")[0].split()
    # 4 sigma: a chance of 1e-4
    assert abs(float(slope) - 0.5 * SLOPE * 1e3 / 9.80665) < 4.0 * float(error)
    assert abs(float(tau) - 300.0) < 4.0 * float(width)


@pytest.mark.slow
def test_without_a_lag_no_late_part_is_told():
    with jax.enable_x64(True):
        found = diagnose(heated(0.0))
    assert found.verdict == "consistent"
    assert not [n for n in found.notes if "follows the probe" in n]


def test_what_was_named_without_some_rests_is_weighed_on_its_own_rows():
    time, accel, _ = hand_log_data.hand_log(rests=40)
    probe = 20.0 + 10.0 * np.sin(2.0 * np.pi * time / time[-1])
    log = Recording(time=time, accel=accel + 1e-3 * probe[:, None], temperature=probe[:, None])
    model = ModelChoice(temperature_degree=1)
    with jax.enable_x64(True):
        problem = prepare(Campaign((log,), Site(GRAVITY), model=model))
        (whole,) = problem.triads
        kept = np.arange(whole.blocks.num_blocks) < whole.blocks.num_blocks - 4
        assert whole.only is not None
        fewer = whole.only(kept)
        column = np.linspace(0.0, 1.0, fewer.blocks.num_blocks)[:, None]
        term = Term("temperature_rate", "accel", (0,), Variant("", {}), (0,), (column,))
        found = Diagnosis("missing-physics", "One effect.")
        assert with_part_late(found, problem, [Beside(fewer, (term,), ())]) == found
