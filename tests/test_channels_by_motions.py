"""The channel of an effect that |f| leaves open: what the columns are, what motions tell, and what is written."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.stats

from diagnose_cases import candidate
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.diagnose.estimates.channels_by_motions import log_odds
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.diagnose.result import Evidence, Explanation
from inertiax.diagnose.selection.verdict import _elsewhere, Named, SAME
from inertiax.diagnose.wording.untold_channels import channel_odds, channels_said, not_applied
from inertiax.effects import CATALOGUE, Signal
from turned_by_hand import GRAVITY, log


SIZE = 0.15  # m/s²/g²
SLOWER = {"rate": 25.0, "noise": 1e-3}
ALIKE = 0.999  # correlation: what is left of a column beside the other is a twentieth of it


def seen_in_magnitude():
    """Columns of |f| by every effect of the force alone in every form on every channel, the model's taken away."""
    rng = np.random.default_rng(1)
    f = rng.standard_normal((4000, 3))
    f /= np.linalg.norm(f, axis=1)[:, None]
    model = np.concatenate(
        [f, np.stack([f[:, i] * f[:, j] for i in range(3) for j in range(i + 1)], 1)], 1
    )
    made = {}
    for effect in CATALOGUE:
        if (
            "accel" not in effect.triads
            or effect.common
            or effect.driver not in ("specific_force", "input")
        ):
            continue
        if not effect.instant or effect.requires:
            continue
        signal = _still(f)
        for variant in effect.variants(signal):
            shape = np.asarray(effect.shape(signal, **variant.settings))
            if shape.shape[2] > 1:
                continue  # its columns are those of the simple forms
            for c in range(3):
                column = np.broadcast_to(shape, (len(f), 3, 1))[:, c, 0] * f[:, c]
                left = column - model @ np.linalg.lstsq(model, column, rcond=None)[0]
                made[effect.name, variant.label, c] = left / max(np.linalg.norm(left), 1e-300)
    return made


def _still(f):
    """A signal of rests in as many directions, g."""
    time, zero, rest = np.arange(len(f), dtype=float), np.zeros_like(f), np.ones(len(f), bool)
    return Signal(
        triad="accel", time=time, input=f, output=GRAVITY * f, since_power=time, since_start=time,
        since_move=time, move=zero, at_rest=rest, temperature=None, force=f, rate=zero,
        degree=0, low=0.0, high=1.0,
    )  # fmt: skip


def test_of_a_sphere_of_directions_only_kpo_is_alike_on_all_channels():
    """By hand: f_p f_o on i enters |f| as f_x f_y f_z / g, whichever i; no other pair of channels is alike."""
    columns = seen_in_magnitude()
    assert {"second_order", "third_order", "odd_quadratic", "scale_asymmetry"} <= {
        n for n, _, _ in columns
    }
    keys = list(columns)
    alike = {
        (a[:2], b[:2])
        for k, a in enumerate(keys)
        for b in keys[k + 1 :]
        if a[2] != b[2] and abs(columns[a] @ columns[b]) > ALIKE
    }
    kpo = ("cross_coupling", "po")
    assert alike == {(kpo, kpo)}


def on(channel, evidence, name="cross_coupling"):
    made = candidate(name, evidence, 2.0 * evidence + 10.0)
    return replace(made, term=replace(made.term, triad="accel", channels=(channel,)))


def test_channels_within_the_bound_of_the_set_stay():
    lead, near, far = on(2, 40.0), on(0, 40.0 - 0.49 * SAME), on(1, 40.0 - 0.51 * SAME)
    other = on(1, 40.0, "second_order")
    assert _elsewhere(lead, [lead, other, near, far], ()) == (near,)
    assert _elsewhere(lead, [lead, near], [near.key]) == ()  # which is named itself


def test_odds_of_motions_ask_nothing_of_their_noise():
    """Nine motions worse by the same amount: t = 9 / √(9 + 8); as one that is far off the others is, by itself 1."""
    t = 9.0 / np.sqrt(17.0)
    expected = np.log(scipy.stats.norm.sf(t) / scipy.stats.norm.cdf(t))
    assert log_odds(np.full(9, 3.0)) == pytest.approx(expected, rel=1e-9)
    one = log_odds(np.eye(9)[4] * 1e6)
    assert one == pytest.approx(np.log(scipy.stats.norm.sf(1.0) / scipy.stats.norm.cdf(1.0)))
    assert log_odds(np.zeros(9)) == 0.0 and log_odds(np.full(9, -1.0)) == 0.0


def test_the_channels_are_said_and_why_the_effect_is_not_applied():
    named = Named(on(2, 40.0), 1e-9, (), (), (on(0, 40.0), on(1, 40.0 - np.log(2.0))))
    odds = channel_odds(named, named.candidate.term)
    assert dict(odds) == pytest.approx({"accel_z": 0.4, "accel_x": 0.4, "accel_y": 0.2})
    assert "accel_z 40 %, accel_x 40 %, accel_y 20 %" in channels_said(odds)
    evidence = Evidence(1.0, 1e-9, 0.5)
    said = Explanation("cross_coupling", ("accel_z",), "po", (), (), (), evidence, "", "", "", odds)
    assert not_applied(said).startswith(
        "cross_coupling on accel_z is not applied in calibration.json"
    )
    assert "accel_z or accel_x or accel_y" in not_applied(said)
    told = Named(on(2, 40.0), 1e-9, ())
    assert channel_odds(told, told.candidate.term) == () and channels_said(()) == ""


def hidden(channel, seed, **kept):
    """A log by hand with Kpo on one channel, and the true specific force to a scale factor and noise."""
    campaign = log(seed, **SLOWER)
    (recording,) = campaign.recordings
    force = (np.asarray(recording.accel) - [0.1, -0.2, 0.05]) / 1.004
    others = [c for c in range(3) if c != channel]
    accel = np.array(recording.accel)
    accel[:, channel] += SIZE * force[:, others[0]] * force[:, others[1]] / GRAVITY**2
    made = eqx.tree_at(lambda r: r.accel, recording, accel)
    for name, value in kept.items():
        made = eqx.tree_at(lambda r, n=name: getattr(r, n), made, value)
    return eqx.tree_at(lambda c: c.recordings, campaign, (made,)), force


@pytest.mark.slow
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_motions_tell_the_channel_and_the_written_calibration_is_nearer(channel):
    campaign, force = hidden(channel, 5 + channel)
    found, beside = diagnose_campaign(campaign)
    (said,) = [e for e in found.effects if e.channels[0].startswith("accel")]
    assert (said.name, said.channels) == ("cross_coupling", (f"accel_{'xyz'[channel]}",))
    assert said.channel_odds == () and found.not_applied == ()
    value = dict(said.parameters)["coefficient"]
    assert abs(value.value - SIZE) < 4.0 * value.std
    plain = calibrate_device(campaign).calibration
    # The bias of the channel by hand: 0.1, -0.2 or 0.05; Kpo pulls its fit by far more than noise.
    truth = np.eye(3) * 0.004
    with jax.enable_x64(True):
        error = [
            np.abs(np.asarray(c.accel_errors(25.0).matrix) - truth).max() for c in (plain, beside)
        ]
    assert error[1] < 0.5 * error[0]


@pytest.mark.slow
def test_without_gyros_all_three_channels_stay_and_nothing_is_applied():
    campaign, _ = hidden(1, 6, gyro=None)
    found, beside = diagnose_campaign(campaign)
    (said,) = found.effects
    assert said.name == "cross_coupling"
    # Outputs are not quite along f (scale factors, misalignments of the fit): a log likelihood apart by tenths.
    assert dict(said.channel_odds) == pytest.approx(
        {"accel_x": 1 / 3, "accel_y": 1 / 3, "accel_z": 1 / 3}, abs=0.1
    )
    assert "does not tell" in said.statement and "gravity's turn" in said.separating_experiment
    assert len(found.not_applied) == 1 and beside.effects == ()
    plain = calibrate_device(campaign).calibration
    with jax.enable_x64(True):
        same = [np.asarray(c.accel_errors(25.0).matrix) for c in (plain, beside)]
    np.testing.assert_allclose(*same, atol=1e-9)
