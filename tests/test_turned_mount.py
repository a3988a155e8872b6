"""From one rest on the device stands turned against its references: told by the checks, and no name of a sensor's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.plausibility import check_campaign


G = 9.81
REST, RESTS = 60, 24
SLIP = np.deg2rad(0.3) * np.array([0.8, 0.0, -0.6])
MATRIX = np.eye(3) + 1e-3 * np.array([[1, 2, -1], [0, -2, 1], [2, 1, 1.5]])
ANGULAR = np.deg2rad(
    np.repeat([40.0, -40.0, 80.0, -80.0], 3)
)  # rad/s, of plateaus about x, y, z in turn


def table(seed, slips=None, gyros_slip=True, errors=None, temperature=None, apart=0.0, rates=False):
    """Rests of a labelled table at 10 Hz, half of them before and after rates about each axis.

    `slips` is a rotation vector from rest 12 on; `errors(f, rest)` adds to the accelerometers; `apart` turns each rest
    by itself, rad.
    """
    rng = np.random.default_rng(seed)
    up = Rotation.random(RESTS, random_state=seed).inv().apply([0.0, 0.0, G])
    force, rate, label, late = [], [], [], []

    def plateaus(after):
        for k, size in enumerate(ANGULAR if rates else ()):
            w = size * np.eye(3)[k % 3]
            angle = np.arange(REST)[:, None] / 10.0 * w
            force.append(Rotation.from_rotvec(-angle).apply(up[0]))
            rate.append(np.tile(w, (REST, 1)))
            label.append(np.full(REST, -1))
            late.append(np.full(REST, after))

    for k in range(RESTS):
        if k == RESTS // 2:
            plateaus(False)
        force.append(np.tile(up[k], (REST, 1)))
        rate.append(np.zeros((REST, 3)))
        label.append(np.full(REST, k))
        late.append(np.full(REST, k >= RESTS // 2))
    plateaus(True)
    force, rate, label, late = (np.concatenate(x) for x in (force, rate, label, late))
    n = len(label)
    turn = Rotation.from_rotvec(late[:, None] * (np.zeros(3) if slips is None else slips))
    own = apart * rng.standard_normal((RESTS, 3))
    seen = Rotation.from_rotvec(np.where(label[:, None] >= 0, own[label], 0.0)) * turn
    felt = seen.apply(force)
    accel = felt @ MATRIX.T + [0.03, -0.02, 0.01] + 4e-4 * rng.standard_normal((n, 3))
    if errors is not None:
        accel += errors(felt, label)
    turned = turn.apply(rate) if gyros_slip else rate
    gyro = turned @ MATRIX.T + 1e-4 + 2e-5 * rng.standard_normal((n, 3))
    warm = np.full(n, 25.0) if temperature is None else temperature(np.arange(n) / n)
    return Recording(
        np.arange(n) / 10.0, accel, gyro, temperature=warm[:, None] + 0.01 * rng.standard_normal((n, 1)),
        position=label, reference_accel=force, reference_gyro=rate, name="table.csv",
    )  # fmt: skip


def campaign(recording, arcsec=5.0):
    """`arcsec` of the rig's positions, as campaign.toml states them."""
    rig = Rig(position_uncertainty=np.deg2rad(arcsec / 3600.0))
    return Campaign((recording,), Site(gravity=G), rig=rig)


def remounted(recording):
    return [f for f in check_campaign(campaign(recording)).findings if f.kind == "remounted"]


def test_the_moment_and_the_angle_of_a_slip_are_told():
    (found,) = remounted(table(1, SLIP))
    said = dict(found.evidence)
    assert said["rests_before"] == 12 and said["began"] == pytest.approx(12 * REST / 10.0)
    # A rest's mean is known to 4e-4 / √60 / G = 5e-6 rad; the rotation's second order is 1e-5.
    np.testing.assert_allclose(said["rotation"], SLIP, atol=3e-5)
    assert "(position 12) the device stands turned by 0.3°" in found.statement


@pytest.mark.parametrize(
    ("too", "says"), [(True, "so do the gyros"), (False, "the accelerometers stand turned")]
)
def test_rates_before_and_after_tell_whether_the_gyros_turned_too(too, says):
    (found,) = remounted(table(2, SLIP, gyros_slip=too, rates=True))
    assert says in found.statement and dict(found.evidence)["gyros_too"] is too


@pytest.mark.parametrize(
    "errors",
    [
        None,
        lambda f, rest: 0.02 * (rest[:, None] >= 12) * [1.0, 0, 0],  # a step of 2 mg
        lambda f, rest: 2e-3 * (f / G) ** 2,  # second order
        lambda f, rest: 5e-3 * np.exp(-rest / 6.0)[:, None] * [0, 1.0, 0],  # warming
        lambda f, rest: 0.01 * (f / G) * (rest[:, None] >= 12),  # scale factors that jump by 0.1 %
    ],
)
def test_errors_of_the_sensor_are_no_turn(errors):
    assert not [s for s in range(8) if remounted(table(10 + s, errors=errors))]


def test_axes_that_move_with_the_temperature_are_no_turn():
    def moved(f, rest):
        warm = -10.0 + 60.0 * np.maximum(rest, 0)[:, None] / RESTS
        return 4e-5 * (warm - 25.0) * np.cross([0.6, 0.0, 0.8], f)

    recording = table(3, errors=moved, temperature=lambda s: -10.0 + 60.0 * s)
    assert not remounted(recording)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 5])
def test_a_slip_is_unexplained_and_names_nothing(seed):
    found = diagnose(campaign(table(seed, SLIP, rates=True)))
    assert found.verdict == "unexplained" and not found.effects
    assert "from 144 s on they stand turned by 0.3°" in found.summary
    assert "model of the accelerometers" not in found.summary
    assert found.where[0].channel == "accel"


@pytest.mark.slow
@pytest.mark.parametrize(("arcsec", "verdict"), [(5.0, "unexplained"), (200.0, "consistent")])
def test_rests_that_stand_by_themselves_are_consistent_where_the_rig_says_so(arcsec, verdict):
    """Each rest is turned by 200 arcsec, 40 times what the better rig states."""
    found = diagnose(campaign(table(6, apart=np.deg2rad(200.0 / 3600.0), rates=True), arcsec))
    assert found.verdict == verdict
    assert ("do not agree with their references" in found.summary) is (verdict == "unexplained")
