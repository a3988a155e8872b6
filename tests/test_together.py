"""Two slow effects of one channel that show together only."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy.stats

from diagnose_cases import score
from diagnose_data import FLICKER, only, slow_noise, sweep
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection import forward as choosing
from inertiax.diagnose.selection.candidate_screening import rank
from inertiax.diagnose.selection.constraints import causes, full, MOST_EFFECTS, twice
from inertiax.diagnose.selection.evidence import Bank, bank, Candidate, count_forms, judge
from inertiax.diagnose.selection.forward import Asked, PAIR
from inertiax.diagnose.selection.multiple_testing import Count, Family, family
from inertiax.diagnose.selection.pairs import best_pair, chance, Pair
from inertiax.effects import CATALOGUE


SLOW = ("drift", "temperature_rate", "temperature_order", "warm_up", "thermal_hysteresis")
NOISE = 6e-7  # rad/s, of each relaxation of the gyros' slow noise


def candidate(name, channel, ratio, evidence=0.0):
    """A candidate of one column with a given likelihood ratio."""
    made = score(np.ones(5), name, channel)
    made = replace(made, term=replace(made.term, chains=(channel,)))
    return Candidate(made.term, made, ratio, evidence)


def test_a_pair_pays_for_all_pairs_of_its_channels_and_for_its_forms():
    # Three slow effects on each of two channels make 2 · 3 pairs; the forms of the two count 4 · 2 of each pair.
    keys = [(name, (c,)) for name in ("a", "b", "c") for c in (0, 1)]
    tests = Family({("a", (0,)): Count(4.0), ("b", (0,)): Count(2.0)}, 1.0)
    found = chance(candidate("a", 0, 14.0), candidate("b", 0, 11.0), tests, keys)
    assert found == pytest.approx(6 * 8 * scipy.stats.chi2.sf(25.0, 2), rel=1e-12)
    assert scipy.stats.chi2.sf(25.0, 2) == pytest.approx(np.exp(-12.5), rel=1e-12)


def test_one_effect_on_three_channels_of_one_row_is_one():
    lags = [candidate("lag", c, 50.0) for c in range(3)]
    lags = [replace(one, term=replace(one.term, chains=(0,))) for one in lags]
    assert causes([one.key for one in lags]) == 1
    assert causes([lags[0].key, lags[0].key, lags[1].key]) == 2
    other = candidate("drift", 0, 20.0)
    assert not full(lags, other)
    many = [candidate(f"effect {k}", 0, 20.0) for k in range(MOST_EFFECTS)]
    assert full(many, other) and not full(many, candidate("drift", 1, 20.0))


def test_a_pair_brings_no_second_one_of_what_a_channel_has_once(monkeypatch):
    once = next(e for e in CATALOGUE if e.name == "warm_up")
    assert once.once

    def of(name, effect=None):
        made = candidate(name, 0, 40.0, evidence=15.0)
        return replace(made, term=replace(made.term, effect=effect))

    pair = Pair(of("warm_up", once), of("drift"), PAIR / 10.0)
    monkeypatch.setattr(choosing, "best_pair", lambda *_: pair)
    with jax.enable_x64(True):
        system = prepare(sweep(1), ()).triads[0].system
    null = NoiseFit((), ())
    asked = Asked(
        system,
        system,
        (),
        [],
        {},
        None,
        Family({}, 0.0),
        null,
        between_all=lambda _: [],
        renew=lambda _, chosen: chosen,
        say=lambda _: None,
    )
    both, nothing = [pair.first, pair.second], Bank((), ())
    assert asked._pair(nothing, [], []) == both
    assert asked._pair(nothing, [], [of("bias_step")]) == both
    assert asked._pair(nothing, [], [of("warm_up", once)]) == []


def test_elements_do_not_lag_behind_a_probe_that_lags_behind_them():
    lag, probe = (
        next(e for e in CATALOGUE if e.name == name) for name in ("thermal_lag", "probe_lag")
    )

    def of(effect, channel):
        made = candidate(effect.name, channel, 40.0)
        return replace(made, term=replace(made.term, effect=effect))

    assert twice([of(probe, 0)], of(lag, 0)) and twice([of(lag, 0)], of(probe, 0))
    assert not twice([of(probe, 0)], of(lag, 1))


def _asked(drift, lag, seed=2):
    """The rarest single effect and the rarest pair on a sweep with flicker and two slow effects on gyro y."""

    def effect(probe, time):
        rng = np.random.default_rng(100 + seed)
        noise = np.stack([slow_noise(rng, time) for _ in range(3)], axis=1) * NOISE / FLICKER
        return noise + only(1, drift * time / 5000.0 + lag * np.gradient(probe, time) / 0.05)

    catalogue = [e for e in CATALOGUE if e.name in SLOW]
    (prepared,) = prepare(sweep(seed, effect=effect), catalogue).triads
    system = prepared.system
    terms = [t for t in prepared.candidates if t.effect is not None]
    null, forms = fit_noise(system), count_forms(terms)
    scores = [
        c.score
        for c in judge(system, bank(system, [null], []), terms, [], forms, "tactical", columns=True)
    ]
    tests = family(scores, [len(y) for y in system.base.observed])
    fuller, ranked = rank(system, [null], terms, [], forms, "tactical")
    alone = min(tests.p_value(c) for c in ranked)
    pair = best_pair(system, fuller, ranked, terms, [], forms, "tactical", tests)
    assert pair is not None
    return alone, pair


@pytest.mark.slow
def test_two_slow_effects_show_together_that_do_not_alone():
    with jax.enable_x64(True):
        alone, pair = _asked(8e-6, -6e-7)
        assert alone > PAIR > 10.0 * pair.p_value
        assert {pair.first.term.name, pair.second.term.name} == {"drift", "temperature_rate"}
        assert pair.first.term.channels == pair.second.term.channels == (1,)
        _, nothing = _asked(0.0, 0.0)
        assert nothing.p_value > PAIR
