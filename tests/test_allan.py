"""Allan deviations against allantools and hand calculation; noise terms against simulated truth."""

import json
import re

import allantools
import numpy as np
import pytest
from allantools.ci import edf_greenhall
from scipy.stats import binom

from hard_limit import run_here
from inertiax.allan import degrees_of_freedom, deviations, identify, interval, KINDS, noise_of
from inertiax.allan.logs import _curve
from inertiax.allan.rest_channels import longest_rest
from inertiax.allan.spectrum import expected_of, tapered
from inertiax.data.recording import Recording
from inertiax.report.noise import noise_document, print_noise


def _log(samples: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return 2.0 + rng.normal(size=samples) + 0.01 * np.cumsum(rng.normal(size=samples))


# A phase of five points by hand: rates 1, 3, 2, 4 at 1 Hz.
def test_deviations_of_four_rates_by_hand():
    rates = np.tile([1.0, 3.0, 2.0, 4.0], 2)
    # Neighbours differ by 2, −1, 2, −3, 2, −1, 2: half the mean square is 27/14.
    found = deviations(rates, rate=1.0, kind="oadev", factors=np.array([1]))
    np.testing.assert_allclose(found.deviation, np.sqrt(27 / 14), rtol=1e-14)
    # Means of two: 2, 3, 2, 3.
    found = deviations(rates, rate=1.0, kind="adev", factors=np.array([2]))
    np.testing.assert_allclose(found.deviation, np.sqrt(0.5), rtol=1e-14)


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("samples, rate", [(1000, 1.0), (20_001, 100.0)])
def test_equal_to_allantools(kind, samples, rate):
    factors = np.array([1, 2, 3, 7, 10, 31, 100, 250, 300])
    if kind in ("mtotdev", "ttotdev"):
        factors = factors[:1] if samples > 1000 else factors[:6]  # it takes minutes there
    log = _log(samples)
    ours = deviations(log, rate=rate, kind=kind, factors=factors)
    tau, theirs, _, count = getattr(allantools, kind)(
        log, rate=rate, data_type="freq", taus=factors / rate
    )
    np.testing.assert_allclose(ours.tau, tau, rtol=1e-12)
    np.testing.assert_allclose(ours.deviation, theirs, rtol=1e-10)
    np.testing.assert_array_equal(ours.count, count)


def test_the_curve_of_a_long_log_is_as_near_the_full_one_as_the_page_says():
    """Over 256 samples and more of 16 neighbours each: within 0.3 %, and an eighth of the 68 % limits."""
    log = 1e-2 * np.random.default_rng(1).normal(size=270_000)
    ours = _curve(log, 100.0)
    tau, theirs, _, _ = allantools.oadev(log, rate=100.0, data_type="freq", taus=ours.tau)
    np.testing.assert_allclose(ours.tau, tau, rtol=1e-12)
    away = np.abs(ours.deviation / theirs - 1.0)
    long = ours.factor >= 256
    assert long.any() and away[~long].max() < 1e-10 and 1e-5 < away[long].max() < 3e-3
    lower, upper = interval(ours, np.zeros(len(tau), int))
    assert np.all(away[long] < (0.125 * 0.5 * (upper - lower) / theirs)[long] * 1.01)


def test_a_long_log_keeps_its_digits():
    # Blocks start their sums anew: one sum over the whole log grows with it, and loses digits.
    log = np.cumsum(np.random.default_rng(0).normal(size=1 << 20))
    factors = np.array([1000, 100_000])
    ours = deviations(log, rate=100.0, kind="mdev", factors=factors)
    theirs = allantools.mdev(log, rate=100.0, data_type="freq", taus=factors / 100.0)[1]
    np.testing.assert_allclose(ours.deviation, theirs, rtol=1e-10)


@pytest.mark.parametrize("kind, order", [("oadev", 2), ("adev", 2), ("mdev", 2), ("ohdev", 3)])
@pytest.mark.parametrize("exponent", [2, 0, -1, -2])
def test_degrees_of_freedom_are_greenhalls(kind, order, exponent):
    overlapping, modified = kind != "adev", kind == "mdev"
    for samples, factor in ((1000, 1), (1000, 10), (1000, 100), (100_000, 3000)):
        theirs = edf_greenhall(exponent, order, factor, samples + 1, overlapping, modified)
        ours = degrees_of_freedom(kind, samples, factor, exponent)
        # Theirs comes from fitted tables where ours is a sum.
        np.testing.assert_allclose(ours, theirs, rtol=0.02)


def test_intervals_cover_white_noise():
    # 90 % intervals at three averaging times over 400 logs of white noise, σ²(τ) = 1/m.
    rng = np.random.default_rng(1)
    factors = np.array([1, 16, 128])
    inside = np.zeros(3)
    for _ in range(400):
        found = deviations(rng.normal(size=1024), rate=1.0, factors=factors)
        low, high = interval(found, np.zeros(3, int), level=0.9)
        truth = 1.0 / np.sqrt(factors)
        inside += (low <= truth) & (truth <= high)
    few, many = binom.ppf([1e-4, 1 - 1e-4], 400, 0.9)
    assert np.all((few <= inside) & (inside <= many)), inside


def test_expected_spectra_are_those_of_simulated_noise():
    rng = np.random.default_rng(2)
    size, runs = 1025, 400
    ordinates = np.arange(1, size // 2 + 1)
    expected = expected_of(size, ordinates, 1.0)
    step = {
        0: lambda: np.diff(rng.normal(size=size + 1), n=2),
        1: lambda: np.diff(rng.normal(size=size)),
        3: lambda: rng.normal(size=size - 1),
    }
    for column, draw in step.items():
        mean = np.mean([tapered(draw()) for _ in range(runs)], axis=0)
        ratio = mean / expected[:, column]
        # An ordinate of five tapers has a relative sigma of √(1/5) at least; near zero it is larger.
        assert np.all(np.abs(ratio - 1.0) < 5.5 * np.sqrt(1.0 / 2.5 / runs)), column
        assert abs(np.mean(ratio[:20]) - 1.0) < 5.0 * np.sqrt(0.5 / runs / 20 * 5)


MONTE_CARLO = """
import json
import numpy as np
from scipy.signal import fftconvolve
from inertiax.allan import identify
rate, size, runs, ramp = 100.0, {size}, {runs}, 2e-6
truth = {truth}
rng = np.random.default_rng(11)
k = np.arange(1, 2 * size)
response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])  # Kasdin's flicker filter
inside, value = {{k: 0 for k in "NBKR"}}, {{k: [] for k in "NBK"}}
for _ in range(runs):
    flicker = fftconvolve(rng.normal(size=2 * size), response)[size : 2 * size]
    walk = np.cumsum(rng.normal(size=size)) / np.sqrt(rate)
    white = rng.normal(size=size) * np.sqrt(rate)
    log = truth["N"] * white + truth["B"] * flicker + truth["K"] * walk
    model = identify(log + ramp * np.arange(size) / rate, rate=rate)
    for name, true in (*truth.items(), ("R", ramp)):
        term = model.terms[name]
        inside[name] += bool(term.lower <= true <= term.upper)
    for name in truth:
        value[name].append(model.terms[name].known)
print(json.dumps([inside, {{k: float(np.mean(v)) for k, v in value.items()}}]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("absent", ["", "B", "BK"])
def test_noise_terms_come_back_with_right_intervals(absent):
    # With all terms present a log of 11 minutes tells them apart; where some are absent they must not take
    # from the others: with the limits of one fit to all terms, 75 % of N's held.
    truth = {"N": 1e-3, "B": 5e-4, "K": 3e-4} | dict.fromkeys(absent, 0.0)
    runs, size = (60, 1 << 14) if absent else (60, 1 << 16)
    code = MONTE_CARLO.format(size=size, runs=runs, truth=truth)
    inside, mean = json.loads(run_here(code, seconds=300.0))
    # 95 % intervals; binomial limits that 1 in 250 sets of four would leave.
    few = binom.ppf(1e-3, runs, 0.95)
    assert min(inside.values()) >= few, inside
    if not absent:
        assert abs(mean["N"] / truth["N"] - 1.0) < 0.01, mean
        assert abs(mean["K"] / truth["K"] - 1.0) < 0.1, mean
        # 11 minutes tell flicker from white noise and walk in two logs of five; in most of the others the walk stands
        # for both.
        assert 0.4 * truth["B"] < mean["B"] < 1.1 * truth["B"], mean


def test_a_log_that_needs_flicker_or_walk_has_one_of_them_at_least():
    # Three minutes of a walk show slow noise, but not whether it is walk or flicker.
    rng = np.random.default_rng(5)
    white = 0.01 * rng.normal(size=16_384)
    model = identify(white + 3e-4 * np.cumsum(rng.normal(size=16_384)) / 10.0, rate=100.0)
    flicker, walked = model.terms["B"], model.terms["K"]
    assert not flicker.shown and not walked.shown
    assert flicker.known == 0.0 and walked.known == pytest.approx(3e-4, rel=0.2)
    assert walked.lower < 3e-4 < walked.upper
    # So the Allan deviation at half a minute is the walk's, √(N²/τ + K² τ/3), not that of white noise, 1.8e-4.
    assert float(model.deviation(np.array([30.0]))[0]) == pytest.approx(9.7e-4, rel=0.2)


def test_white_noise_is_told_in_both_conventions():
    rng = np.random.default_rng(5)
    model = identify(0.02 * rng.normal(size=1 << 15), rate=400.0, triad="accel")
    white = model.terms["N"]
    assert white.lower <= 1e-3 <= white.upper  # 0.02 m/s² at 400 Hz is 1e-3 m/s²/√Hz
    assert abs(model.discrete_sigma / 0.02 - 1.0) < 0.02
    assert not model.terms["K"].shown and not model.terms["R"].shown
    # The model's Allan deviation is that of the log.
    tau = np.array([0.01, 0.1, 1.0])
    np.testing.assert_allclose(model.deviation(tau), 1e-3 / np.sqrt(tau), rtol=0.1)


def test_a_ramp_is_found():
    rng = np.random.default_rng(6)
    time = np.arange(1 << 14) / 100.0
    ramp = identify(1e-3 * rng.normal(size=len(time)) + 2e-6 * time, rate=100.0).terms["R"]
    # Slope of white noise: σ √(12 / n) / T = 1.65e-7.
    assert ramp.shown and abs(ramp.value - 2e-6) < 4.0 * ramp.std
    assert 1.6e-7 < ramp.std < 2.4e-7


def test_what_no_term_explains_shows_in_chi2():
    time = np.arange(1 << 14) / 100.0
    log = np.random.default_rng(7).normal(size=len(time))
    assert identify(log, rate=100.0).chi2_per_dof < 2.5
    assert identify(log + 0.3 * np.sin(2 * np.pi * 3.0 * time), rate=100.0).chi2_per_dof > 10.0


@pytest.mark.parametrize("log, words", [(np.ones(1000), "constant"), (np.ones(100), "256 or more")])
def test_bad_logs_are_refused(log, words):
    with pytest.raises(ValueError, match=words):
        identify(log, rate=100.0)


# From a recording to a document -------------------------------------------------------------------


def test_the_longest_rest_of_a_recording_is_told_with_units():
    rng = np.random.default_rng(8)
    time = np.arange(6000) / 100.0
    position = np.where(time < 10.0, 0, np.where(time < 12.0, -1, 1))
    gyro = 1e-3 * rng.normal(size=(6000, 3)) + np.where(position < 0, 0.5, 0.0)[:, None]
    gyro[:, 2] = 0.25  # a dead channel
    found = noise_of(Recording(time=time, gyro=gyro, position=position, name="log"))
    assert [c.channel for c in found.channels] == ["gyro_x", "gyro_y"]
    assert any("gyro_z is constant" in n for n in found.notes)
    assert any("only the longest rest is used: 48 s from 12 s on" in n for n in found.notes)
    document = json.loads(json.dumps(noise_document([found])))
    channel = document["logs"][0]["channels"]["gyro_x"]
    white = channel["terms"]["N"]
    assert white["unit"] == "rad/s/sqrt(Hz)" and white["usual"]["unit"] == "deg/sqrt(h)"
    # 1e-3 rad/s at 100 Hz: 1e-4 rad/s/√Hz, 0.344 °/√h; one sample 1e-3 rad/s. 48 s tell it to 1 %.
    np.testing.assert_allclose(white["value"], 1e-4, rtol=0.05)
    np.testing.assert_allclose(white["usual"]["value"], 0.3438, rtol=0.05)
    np.testing.assert_allclose(channel["discrete"]["white"]["value"], 1e-3, rtol=0.05)
    assert channel["discrete"]["white"]["unit"] == "rad/s"


@pytest.fixture(scope="module")
def warming():
    """A log at rest that warms up by 20 °C, with drifts of millions of the data sheets' units."""
    rng, time = np.random.default_rng(13), np.arange(6000) / 20.0
    made = {
        name: size * (rng.normal(size=(6000, 3)) + [0.3, 2.0, 50.0] * np.exp(-time / 90.0)[:, None])
        for name, size in (("accel", 2.0), ("gyro", 0.1))
    }
    temperature = 20.0 + time[:, None] / 15.0
    position = np.zeros(6000, int)
    return Recording(time=time, temperature=temperature, position=position, **made)


@pytest.fixture(scope="module")
def warmed(warming):
    return noise_of(warming)


def test_a_table_of_noise_is_whole_in_eighty_columns(warmed, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")  # and is not squeezed where there are fewer
    print_noise([warmed])
    shown = capsys.readouterr().out
    table = [
        line for line in shown.splitlines() if not line.startswith(("note", "accel_", "gyro_"))
    ]
    assert max(map(len, table)) <= 80
    # A number is cut with an ellipsis at its end; limits have one between two numbers.
    assert not re.search(r"…\s|…$|e\+", shown)
    assert re.search(r"K  acceleration random walk, \(m/s\)/h\^\(3/2\) +x ", shown)
    # 2 m/s² at 20 Hz are 26.8 (m/s)/√h, and one sample is 204 mg again.
    assert re.search(r"N  velocity random walk, \(m/s\)/sqrt\(h\) +x +2[67](\.\d)?  2", shown)
    assert re.search(r"N as one sample at 20 Hz, mg +x +20\d  ", shown)
    assert "N holds for 20 samples a second that are not averaged" in shown


def test_of_compensated_columns_the_temperature_is_said_to_be_what_is_left(warming):
    raw, left = (longest_rest((warming,), compensated=known)[1] for known in (False, True))
    assert any("by 20.0 °C, which looks like" in n and "compensate the log" in n for n in raw)
    assert any("by 20.0 °C: the columns are compensated" in n for n in left)
    assert not any("compensate the log" in n for n in left)


def test_terms_that_a_drift_hides_are_said_once_with_the_reason(warming):
    drifting = noise_of(warming, compensated=True)  # and no temperature is blamed
    (said,) = [n for n in drifting.notes if "drift as none of the terms does" in n]
    assert "accel_z" in said and "(R) are not told" in said
    assert not any("does not determine random walk" in n and "accel_z" in n for n in drifting.notes)


def test_a_recording_without_a_rest_is_refused():
    time = np.arange(1000) / 100.0
    gyro = np.random.default_rng(9).normal(size=(1000, 3))
    moving = Recording(time=time, gyro=gyro, position=np.full(1000, -1), name="moving")
    with pytest.raises(ValueError, match="moving: the longest rest has 0 samples"):
        noise_of(moving)


def _warming(drift, *, seconds=1200.0, rate=20.0, walk=0.0, span=30.0):
    rng = np.random.default_rng(8)
    count = int(seconds * rate)
    time = np.arange(count) / rate
    probe = 20.0 + span * (1.0 - np.exp(-time / 400.0))
    x = (probe - 35.0)[:, None] / 15.0
    gyro = 1e-3 * rng.standard_normal((count, 3)) + drift * (x + 0.3 * x**2)
    gyro += walk / np.sqrt(rate) * np.cumsum(rng.standard_normal((count, 3)), axis=0)
    return Recording(time=time, gyro=gyro, temperature=probe[:, None], name="warm.csv")


@pytest.mark.parametrize("drift", [3e-4, 3e-3, 3e-2])
def test_a_drift_with_temperature_is_no_random_walk(drift):
    found = noise_of(_warming(drift))
    for channel in found.channels:
        assert not any(channel.model.terms[term].shown for term in "BKR")
        # N = 1e-3 / √20 by hand; its interval is 95 %, and three axes are asked.
        assert channel.model.terms["N"].value == pytest.approx(1e-3 / np.sqrt(20.0), rel=0.05)
    assert any("follow the temperature" in n for n in found.notes)


def test_a_walk_at_a_steady_temperature_and_in_compensated_columns_keeps_its_value():
    steady = noise_of(_warming(0.0, walk=3e-5, seconds=3600.0, span=0.5))
    assert all(c.model.terms["K"].shown for c in steady.channels)
    told = noise_of(_warming(0.0, walk=3e-5, seconds=3600.0), compensated=True)
    assert all(c.model.terms["K"].shown for c in told.channels)
    white = noise_of(_warming(0.0))
    assert not [n for n in white.notes if "follow the temperature" in n]
