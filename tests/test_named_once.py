"""An effect that came in two forms on one channel, of which one holds the other, is named once, with a size."""

import re

import jax
import numpy as np
import pytest

from diagnose_data import G, poses
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.result import Parameter
from inertiax.diagnose.selection.constraints import holds
from inertiax.diagnose.selection.evidence import Candidate, count_forms
from inertiax.diagnose.selection.forward import Asked
from inertiax.diagnose.selection.multiple_testing import family
from inertiax.diagnose.selection.score_test import whiten_system
from inertiax.diagnose.selection.verdict import Named, once
from inertiax.diagnose.wording.sentences import Said, sentence
from inertiax.effects import CATALOGUE


ROW = np.array([4.7, 2.4, -14.8]) * np.pi / 180.0 / 3600.0  # rad/s/g, of gyro x
G_SENSITIVITY = tuple(e for e in CATALOGUE if e.name == "g_sensitivity")


def gyros():
    """Gyros in 36 attitudes, 10 s at rest in each, 4 Hz."""
    rng = np.random.default_rng(3)
    force = np.repeat(poses(), 48, axis=0)
    position = np.concatenate([np.r_[np.full(8, -1), np.full(40, k)] for k in range(36)])
    output = np.outer(force @ ROW, [1.0, 0.0, 0.0]) + 1e-5
    output += 5e-6 * rng.standard_normal(output.shape)
    recording = Recording(
        np.arange(len(force)) * 0.25,
        gyro=output,
        reference_accel=G * force,
        reference_gyro=np.zeros_like(force),
        position=position,
    )
    model = ModelChoice(gyro_estimator="static", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "tactical")


@pytest.fixture(scope="module")
def asked():
    """The search of the gyros' rows, and the forms of x's g-sensitivity by label."""
    with jax.enable_x64(True):
        (prepared,) = prepare(gyros(), G_SENSITIVITY).triads
        noise = fit_noise(prepared.system)
        scores = whiten_system(prepared.system, noise, prepared.candidates).scores
        forms = {t.variant.label: t for t in prepared.candidates if t.channels == (0,)}
        ask = Asked(
            prepared.system, prepared.system, tuple(prepared.candidates), list(prepared.candidates),
            count_forms(prepared.candidates), "tactical",
            family(scores, [len(y) for y in prepared.system.base.observed]), noise,
            lambda term: [], lambda noise, terms: terms, lambda text: None,
        )  # fmt: skip
        yield (
            ask,
            noise,
            {s.term.variant.label: s for s in scores if s.term.channels == (0,)},
            forms,
        )


@pytest.mark.parametrize("named", [("row", "row"), ("z", "row"), ("row", "x")])
def test_a_form_that_another_holds_is_no_second_name(asked, named):
    ask, noise, scores, forms = asked
    first = [Named(Candidate(forms[k], scores[k], 99.0, 9.0), 1e-9, ()) for k in named]
    with jax.enable_x64(True):
        (made,) = once(ask, first, [fit_noise(ask.system, [forms["row"]])])
    score = made.candidate.score
    assert made.candidate.term.variant.label == "row"
    off = (score.coefficients - ROW) / np.sqrt(np.diagonal(score.covariance))
    assert abs(off).max() < 4.0  # the whole row, none of it held at zero


def test_forms_that_do_not_hold_one_another_stay(asked):
    ask, noise, scores, forms = asked
    two = [Named(Candidate(forms[k], scores[k], 99.0, 9.0), 1e-9, ()) for k in ("z", "x")]
    assert once(ask, two, [noise]) == two
    assert holds(forms["row"], forms["y"]) and not holds(forms["y"], forms["row"])


def test_a_doubt_is_of_the_form_that_it_concerns():
    (known,) = G_SENSITIVITY
    value = (("coefficient y", Parameter(2e-5, 3e-6, "rad/s/g")),)
    odds = (("g_sensitivity", 0.25), ("magnetic", 0.75))
    said = [Said(("gyro_y",), value, odds, form="y"), Said(("gyro_y",), value, odds[:1], form="z")]
    text = sentence(known, {"axes": "y"}, said)
    assert re.search(r"On gyro_y \(form y\) this data cannot decide between", text)
