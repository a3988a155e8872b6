"""A target that is far away: the session goes on, says so once with what limits, and ends where nothing gains."""

from collections.abc import Iterator

import numpy as np
import pytest

from inertiax.data.recording import Campaign, Rig, Site
from inertiax.live import far_target, session as live_session
from inertiax.live.estimate import Estimate, estimate
from inertiax.live.far_target import far_target_in_words, nothing_gains, rests_to_target
from inertiax.live.rest_ledger import Rest
from inertiax.live.session import Session
from inertiax.live.target import parse_target


GRAVITY = 9.81
CAMPAIGN = Campaign((), Site(GRAVITY), Rig())
FAR = parse_target("accel.bias=0.05 mg, accel.scale=50 ppm")


def estimated(count: int, *, own: float, scatter: float, up: np.ndarray | None = None) -> Estimate:
    """Of rests in directions `up`, by default all over, with this noise of a mean and this scatter (m/s²)."""
    rng = np.random.default_rng(5)
    up = rng.standard_normal((count, 3)) if up is None else up
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    accel = (
        GRAVITY * up + [0.1, -0.2, 0.05] + np.hypot(own, scatter) * rng.standard_normal(up.shape)
    )
    rests = []
    for k, mean in enumerate(accel):
        rest = Rest(k + 1, 1, 500 * k, 500 * k + 400, (5.0 * k, 5.0 * k + 4.0))
        rest.accepted, rest.accel, rest.accel_covariance = True, mean, own**2 * np.eye(3)
        rests.append(rest)
    found = estimate(rests, CAMPAIGN, FAR)
    for _ in range(3):  # the linearisation
        found = estimate(rests, CAMPAIGN, FAR, found)
    return found


def test_a_far_target_is_told_while_positions_gain():
    found = estimated(24, own=1e-3, scatter=0.02)
    further = rests_to_target(found)
    # n (ρ² − 1), by hand
    assert further == pytest.approx(24 * (found.ratio**2 - 1.0), abs=1.0) and further > 1000
    position = found.next_position()
    assert position is not None and position.gain > 0.01
    assert not nothing_gains(found)


def test_a_target_in_reach_and_few_rests_are_told_nothing():
    assert rests_to_target(estimated(24, own=3e-4, scatter=1e-5)) is None
    assert rests_to_target(estimated(12, own=1e-3, scatter=0.02)) is None


def test_nothing_gains_where_the_best_position_is_said_to_gain_nothing():
    found = estimated(600, own=1e-3, scatter=0.05)
    position = found.next_position()
    assert position is not None and position.gain < far_target.NO_GAIN and nothing_gains(found)


@pytest.mark.parametrize(
    ("own", "scatter", "limit"),
    [
        (1e-3, 0.02, "the scatter of the accelerometers from rest to rest"),
        (0.02, 1e-4, "the noise of the accelerometers within a rest"),
    ],
)
def test_what_limits_is_named(own, scatter, limit):
    said = far_target_in_words(estimated(24, own=own, scatter=scatter), 2700)
    assert said.startswith("the target is about 2700 rests like these away. ") and "\n" not in said
    assert f"What limits is {limit}" in said and "The session goes on" in said


def test_a_session_far_from_its_target_goes_on_and_says_so_once(monkeypatch):
    found = estimated(24, own=1e-3, scatter=0.02)
    session = Session(CAMPAIGN, FAR)
    session.rests = [Rest(1, 1, 0, 400, (0.0, 4.0))]
    session.rests[0].accepted = True
    nothing: list[dict] = []
    monkeypatch.setattr(live_session, "estimate", lambda *_: found)

    def refresh(*_, **__) -> Iterator[dict]:
        yield from nothing

    monkeypatch.setattr(session, "_refresh", refresh)
    told = []
    for _ in range(3):  # rests end
        told += [*session._answer(), *session._stop(400)]
    assert [e["event"] for e in told].count("done") == 0 and not session.finished
    far = [e for e in told if e["event"] == "problem"]
    assert [(e["kind"], e["severity"]) for e in far] == [("target", "note")]
