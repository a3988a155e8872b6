"""A lag whose signature is made of the slopes that it has bent itself; data from plain NumPy."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from diagnose_data import behind
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose_model
from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.custom_model import prepare_model
from inertiax.diagnose.estimates.applied_effects import compensate
from inertiax.diagnose.estimates.separable import refined, renewed
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.diagnose.problem import prepare, retuned
from inertiax.diagnose.result import Parameter
from inertiax.diagnose.selection.score_test import _columns_seen, _score
from inertiax.diagnose.wording.sentences import Said, sentence
from inertiax.effects import CATALOGUE, Variant


LAG = [e for e in CATALOGUE if e.name == "thermal_lag"]
TAU = 300.0  # s
NOISE = 2e-6  # rad/s
G = 9.81
KEPT = ("time", "gyro", "temperature", "position")
PARTS = (slice(0, 1050), slice(2750, 4000))


def bent(seed=0, noise=NOISE):
    """One pose, up and down once; the bias of x is a parabola of its element's temperature, which lags."""
    rng = np.random.default_rng(seed)
    time = np.arange(4000) * 1.0
    probe = np.interp(
        time, [0.0, 400.0, 1700.0, 2100.0, 3400.0, 4000.0], [-10, -10, 50, 50, -10, -10]
    )
    x, y = (probe - 20.0) / 30.0, (behind(time, probe, TAU) - 20.0) / 30.0
    output = 1e-4 * np.stack([y - 0.6 * y**2, 0.5 * x, x**2], axis=1)
    output += noise * rng.standard_normal(output.shape)
    recording = Recording(
        time=time, gyro=output, temperature=probe[:, None], position=np.zeros(4000, int)
    )
    model = ModelChoice(gyro_estimator="static", temperature_degree=2)
    return Campaign((recording,), Site(G), Rig(), model, "tactical")


def at_the_elements_temperature(campaign):
    """Time constant by SciPy: least squares of a parabola of the lagged temperature, sample by sample."""
    (recording,) = campaign.recordings
    probe, output = recording.temperature[:, 0], recording.gyro[:, 0]

    def misfit(tau):
        x = (behind(recording.time, probe, tau) - 20.0) / 30.0
        return np.linalg.lstsq(np.vander(x, 3), output, rcond=None)[1][0]

    return minimize_scalar(misfit, bounds=(100.0, 900.0), method="bounded").x


def on_x(prepared):
    """The lag of the gyro x with the grid's nearest time constant, and the noise beside it."""
    term = min(
        (t for t in prepared.candidates if t.channels == (0,) and t.name == "thermal_lag"),
        key=lambda t: abs(t.setting - TAU),
    )
    return term, fit_noise(prepared.system, [term])


@pytest.mark.slow
def test_the_slopes_that_a_lag_has_bent_are_fitted_beside_it():
    with jax.enable_x64(True):
        (prepared,) = prepare(bent(), LAG).triads
        term, noise = on_x(prepared)
        (first,) = retuned(prepared, term, [TAU])
        about, (last,), (spread,) = refined(prepared, noise, [term])
        (at_truth,) = retuned(about, term, [TAU])
        # The first noise holds what the bent slopes left.
        _, (final,), (white,) = refined(prepared, fit_noise(prepared.system, [last]), [last])
    assert spread is not None
    by_hand = at_the_elements_temperature(bent())
    # The probe's temperature is smoothed over 20 s, which rounds its corners: 0.2 % of such a lag.
    assert white is not None and abs(final.setting - by_hand) < 2.0 * white < 0.01 * TAU
    assert abs(last.setting - TAU) < 3.0 * spread
    # By hand: the signature of the true parabola at the true lag, from plain NumPy.
    time, probe = np.asarray(prepared.signal.time), np.asarray(prepared.signal.temperature)
    x, y = (probe - 20.0) / 30.0, (behind(time, probe, TAU) - 20.0) / 30.0
    true = prepared.blocks.mean(1e-4 * ((y - 0.6 * y**2) - (x - 0.6 * x**2)))
    wrong, right = (
        np.linalg.norm(t.columns[0][:, 0] - true) / np.linalg.norm(true) for t in (first, at_truth)
    )
    assert wrong > 0.2  # made of the bent slopes
    assert right < 0.03  # the noise of 4000 samples leaves a few per cent
    assert renewed(prepared, noise, [term])[0].setting == last.setting


@pytest.mark.slow
def test_the_lag_is_named_sized_and_taken_away():
    campaign = bent(1)
    found, calibration = diagnose_campaign(campaign)
    assert [e.name for e in found.effects] == ["thermal_lag"]
    values = dict(found.effects[0].parameters)
    lag, amplitude = values["time_constant"], values["amplitude"]
    assert abs(lag.value - TAU) < 3.0 * lag.std and lag.std < 0.05 * TAU
    assert abs(amplitude.value - 1.0) < 3.0 * amplitude.std and amplitude.std < 0.1
    # The gyros are at rest: means over 100 s are of white noise alone, of which 40 are known to a ninth.
    rate = np.asarray(compensate(calibration, campaign.recordings[0]).gyro)
    means = rate.reshape(40, 100, 3).mean(axis=1)
    assert np.sqrt(np.mean(means**2, axis=0)).max() < 1.5 * NOISE / np.sqrt(100)


@pytest.mark.slow
@pytest.mark.parametrize("files", [2, 1])
def test_what_a_pause_did_to_the_elements_is_not_taken_for_recorded(files):
    (whole,) = bent(3).recordings
    # Half of the way up, the soak and half of the way down are not recorded: 40 °C on a straight line.
    parts = [replace(whole, **{k: getattr(whole, k)[rows] for k in KEPT}) for rows in PARTS]
    if files == 1:
        rows = np.concatenate([np.arange(4000)[p] for p in PARTS])
        parts = [replace(whole, **{k: getattr(whole, k)[rows] for k in KEPT})]
    found = diagnose_campaign(replace(bent(3), recordings=tuple(parts)))[0]
    assert [e.name for e in found.effects] == ["thermal_lag"]
    lag = dict(found.effects[0].parameters)["time_constant"]
    assert abs(lag.value - TAU) < 3.0 * lag.std < 0.1 * TAU


@pytest.mark.slow
def test_biases_beside_a_lag_carry_what_is_not_known_of_it():
    """A time constant known to 7 to 25 %, and elements that a pause left warmer by some 14 °C, known to two."""
    misses = []
    for seed in range(5):
        campaign = bent(seed, 2e-5)
        parts = [replace(campaign.recordings[0], **kept) for kept in _apart(campaign)]
        found, calibration = diagnose_campaign(replace(campaign, recordings=tuple(parts)))
        assert [e.name for e in found.effects] == ["thermal_lag"]
        at = np.array([-5.0, 5.0, 15.0])
        values, sigmas = (np.asarray(x)[:, 0] for x in calibration.gyro.over(at))
        x = (at - 20.0) / 30.0
        misses.append((values - 1e-4 * (x - 0.6 * x**2)) / sigmas)
    # With the coefficient's uncertainty alone 2.5. Of five campaigns with three values each that go together, the root
    # mean square is below 1.8 but once in 150 (χ² of five).
    assert np.sqrt(np.mean(np.square(misses))) < 1.8


def _apart(campaign):
    """Columns of the campaign's one recording before and after its pause."""
    (whole,) = campaign.recordings
    return [{k: getattr(whole, k)[rows] for k in KEPT} for rows in PARTS]


@pytest.mark.slow
def test_a_users_model_is_fitted_beside_the_lag_as_well():
    campaign = bent(2)

    def predict(parameters, signal):
        x = (jnp.asarray(signal.temperature) - 20.0) / 30.0
        powers = jnp.stack([x**k for k in range(parameters["degree"] + 1)], axis=1)
        return powers @ parameters[parameters["term"]]

    # The user's own fit without the lag: what the lag bends.
    x = (campaign.recordings[0].temperature[:, 0] - 20.0) / 30.0
    basis = np.stack([np.ones_like(x), x, x**2], axis=1)
    bias = np.linalg.lstsq(basis, campaign.recordings[0].gyro, rcond=None)[0]
    # A pytree may hold what is no parameter.
    start = {"bias": bias, "term": "bias", "degree": 2}
    with jax.enable_x64(True):
        prepared = prepare_model(predict, start, campaign, LAG, triad="gyro")
        term, noise = on_x(prepared)
        _, (own,), (spread,) = refined(prepared, noise, [term])
    assert abs(own.setting - TAU) < 3.0 * spread
    found = diagnose_model(predict, start, campaign.recordings[0], triad="gyro")
    (value,) = [dict(e.parameters)["time_constant"] for e in found.effects]
    assert value.value == pytest.approx(own.setting, abs=3.0 * spread)


def test_coefficients_that_the_rows_do_not_tell_have_no_standard_deviation():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 60))

    def told(*columns):
        rows = np.stack(columns, axis=1)
        term = Term("g_sensitivity", "gyro", (0,), Variant("row", {}), (0,), (rows,))
        seen = _columns_seen(np.square(rows).sum(axis=0), rows, rng.standard_normal(60))
        score = _score(term, {0: rows}, seen)
        assert score is not None
        return score.told.tolist()

    assert told(a, b) == [True, True]
    # The third never acts; the second and the fourth tell their sum alone.
    assert told(a, b, 0.0 * a, b) == [True, False, False, False]


def test_the_sentence_says_which_coefficients_are_not_told():
    effect = next(e for e in CATALOGUE if e.name == "g_sensitivity")
    values = (
        ("coefficient[0]", Parameter(4e-4, 3e-5, "rad/s/g")),
        ("coefficient[1]", Parameter(0.0, None, "rad/s/g")),
        ("coefficient[2]", Parameter(2e-4, None, "rad/s/g")),
    )
    text = sentence(effect, {"axes": "xyz"}, [Said(("gyro_x",), values, (("g_sensitivity", 1.0),))])
    # 4e-4 rad/s are 82.5 °/h.
    assert "coefficient[0] 82.5 ± 6.2 °/h/g" in text
    assert "coefficient[1] not determined by this data" in text
    assert "coefficient[2] about 41.25 °/h/g (not determined by this data)" in text
