"""Rivals of different kinds: one effect of several coefficients against two simple ones, unlisted against listed."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from diagnose_cases import candidate
from diagnose_data import oblique, only, tumble
from inertiax.diagnose import diagnose
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection import forward as choosing
from inertiax.diagnose.selection.evidence import Bank, observations
from inertiax.diagnose.selection.forward import Asked, FURTHER, MARGIN
from inertiax.diagnose.selection.multiple_testing import Count, Family
from inertiax.effects import CATALOGUE


NOTHING = NoiseFit((), ())


def asked(system):
    """A search in which nothing is known yet."""
    return Asked(
        system,
        system,
        (),
        [],
        {},
        None,
        Family({}, 1.0),
        NOTHING,
        between_all=lambda _: [],
        renew=lambda _, chosen: chosen,
        say=lambda _: None,
    )


@pytest.mark.slow
def test_two_simple_effects_stand_before_one_of_three_coefficients():
    k2, kio = 3e-3, -1.5e-3  # m/s²/g², on accel x and of f_y f_x on accel y

    def effect(force, time):
        return only(0, k2 * force[:, 0] ** 2) + only(1, kio * force[:, 1] * force[:, 0])

    # Kip, Kio and Kpo of accel y explain as much, with an absurd Kpo of 3 m/s²/g² on what is left of f_x f_y f_z.
    found = diagnose(tumble(5, effect))
    values = {e.name: (e.channels, e.parameters[0][1]) for e in found.effects}
    assert set(values) == {"second_order", "cross_coupling"}
    # A second coefficient may come in, as large as noise makes one that pays for itself.
    further = [p for e in found.effects for _, p in e.parameters[1:]]
    assert len(further) <= 1 and all(abs(p.value) < 3.0 * p.std for p in further)
    (on, second), (across, product) = values["second_order"], values["cross_coupling"]
    assert on == ("accel_x",)
    # By hand: f_x = f_x³ + f_x f_y² + f_x f_z², and the bias takes f_x. So K2 and Kio on y are to |f| what
    # K2 - Kio and Kip = -Kio on z are.
    other = across == ("accel_z",)
    assert other or across == ("accel_y",)
    assert second.value == pytest.approx(k2 - kio if other else k2, abs=4.0 * second.std)
    assert product.value == pytest.approx(-kio if other else kio, abs=4.0 * product.std)
    assert second.std < 0.05 * k2 and product.std < 0.2 * abs(kio)


@pytest.mark.slow
def test_what_is_scored_beside_the_rigs_errors_is_no_rival_of_what_is_not(monkeypatch):
    with jax.enable_x64(True):
        system = prepare(oblique(2), ()).triads[0].system
    assert system.shared is not None
    mixed = candidate("~input and time", 40.0)  # scored on all channels together
    slow = candidate("~course of time", 30.0)
    listed = candidate("drift", 10.0)
    assert mixed.term.follows_input and not slow.term.follows_input
    alone = {}

    def judge(apart, bank, terms, *_):
        assert apart.shared is None
        known = {id(c.term): c for c in (mixed, slow, listed)}
        return [replace(known[id(t)], evidence=alone[t.name]) for t in terms]

    monkeypatch.setattr(choosing, "judge", judge)

    def leads(*rivals):
        return asked(system)._leading_open(Bank((), ()), [*rivals, listed], listed, [])

    alone |= {"drift": 10.0, "~input and time": 10.0 + MARGIN - 0.1, "~course of time": 30.0}
    assert leads(mixed) is None
    assert leads(mixed, slow) is slow  # of the catalogue's own kind: nothing changes for it
    alone["~input and time"] = 10.0 + MARGIN + 0.1
    assert leads(mixed, slow) is mixed
    assert asked(system)._leading_open(Bank((), ()), [mixed], None, []) is mixed


@pytest.mark.slow
def test_a_pair_stands_for_an_unlisted_dependence_where_the_second_is_rare_by_itself(monkeypatch):
    listed, unlisted = candidate("drift", 11.0, 28.0), candidate("~bump", 35.0, 87.0)
    second = candidate("warm_up", 27.0, 60.0)
    system = prepare(oblique(2), ()).triads[0].system
    monkeypatch.setattr(choosing, "fit_noise", lambda *_: NOTHING)
    fuller = Bank((NOTHING,), ((0.0, 0.0, 0.0),))
    monkeypatch.setattr(Bank, "leader", NOTHING)

    def beats(more, chosen=()):
        monkeypatch.setattr(choosing, "rank", lambda *_: (fuller, more))
        return asked(system)._pair_beats(fuller, listed, unlisted, [c.term for c in chosen])

    assert beats([second])
    assert not beats([replace(second, evidence=23.0)])  # 11 + 23 < 35
    assert not beats([replace(second, ratio=4.0)])
    assert not beats([])
    first = [candidate("settling", 50.0)]
    assert not beats([second], first)  # 11 + 27 is less than a margin above 35
    assert beats([replace(second, evidence=24.1 + MARGIN)], first)


def test_an_effect_that_noise_makes_often_does_not_stand_before_a_rare_one():
    jump, rare = (
        candidate("bias_step", 0.9, ratio=16.0),
        candidate("g_sensitivity", 0.5, ratio=20.0),
    )
    late = candidate("drift", -0.1, ratio=30.0)  # rare, and still less likely than nothing
    # A jump has 200 moments: 2 · 200 · 6.3e-5 = 2.5 %; the other effect 2 · 7.7e-6.
    tests = Family({jump.key: Count(200.0), rare.key: Count(1.0)}, 1.0)
    with jax.enable_x64(True):
        system = prepare(oblique(2), ()).triads[0].system
    ask = replace(asked(system), tests=tests)

    def taken(*leading, unlisted=None, chosen=()):
        first = leading[0] if leading else None
        return ask._first_that_passes(leading, first, unlisted, choosing.GATE, chosen)

    assert ask.chance(jump) > choosing.GATE > ask.chance(rare)
    assert taken(jump, rare) is rare
    assert taken(jump, late) is jump  # which does not pass
    assert taken(jump, rare, unlisted=candidate("~bump", 9.0)) is jump
    assert taken(rare, jump) is rare
    assert taken() is None
    # Beside an effect on the same rows it has to be likelier, and on other rows it does not.
    there = candidate("settling", 50.0)
    assert taken(jump, rare, chosen=[there]) is jump
    likelier = replace(rare, evidence=FURTHER + 0.1)
    assert taken(replace(jump, evidence=3.0), likelier, chosen=[there]) is likelier
    elsewhere = replace(there, term=replace(there.term, chains=(1,)))
    assert taken(jump, rare, chosen=[elsewhere]) is rare


@pytest.mark.slow
def test_what_follows_the_input_is_observed_once_a_dwell():
    with jax.enable_x64(True):
        (prepared,) = prepare(
            tumble(1), [e for e in CATALOGUE if e.name in ("drift", "second_order")]
        ).triads
    dwells, blocks = len(np.unique(prepared.blocks.dwell)), prepared.blocks.num_blocks
    assert dwells < blocks
    count = {
        (t.name, t.variant.label): observations(prepared.system, t) for t in prepared.candidates
    }
    assert {count[k] for k in count if k[0] == "second_order"} == {dwells}
    assert {count[k] for k in count if k[0] == "drift"} == {blocks}
    # A field fixed to the room turns with the case: it is judged under the noise of g-sensitivity, its rival.
    field = candidate("magnetic", 10.0)
    assert field.term.follows_input and candidate("g_sensitivity", 10.0).term.follows_input
