"""Rests in which the device was knocked, slipped or tilted: found by both triads, left out, counted and said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from inertiax import reduce_to_dwells
from inertiax.calibrate.pipeline import calibrate, calibrate_device
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.diagnose.observations.model_rows import ModelForm, usable
from inertiax.reduction.clipping import clipped
from inertiax.reduction.handling import kept_sentence, left_out_sentence, Undisturbed
from inertiax.reduction.held_rests import variance_by_parts
from inertiax.reduction.knocks import levels_of, spiked
from inertiax.reduction.quiet_level import Bursts
from inertiax.reduction.rest_ends import quiet_part
from inertiax.reduction.rests import find_rests
from inertiax.reduction.segments import segment
from inertiax.reduction.tilts import slips, tilting


RATE = 100.0  # Hz
G = 9.81
ACCEL, GYRO = 0.02, 1e-3  # 1 sigma of one sample, m/s² and rad/s
GYRO_BIAS = np.array([0.01, -0.02, 0.005])
REST, MOVE = 800, 200  # rows


class Hand:
    """Rests in random poses joined by turns, made with SciPy's rotations; `turns[k]` is what rest k does, rad."""

    def __init__(self, rng, rests=12, turns=None, poses=None):
        turns, poses = turns or {}, poses or {}
        attitude, position = [], []
        pose = poses[0] if poses else Rotation.random(None, rng)
        for k in range(rests):
            own = turns.get(k, np.zeros((REST, 3)))
            rest = pose * Rotation.from_rotvec(own)
            following = Rotation.random(None, rng)
            following = poses.get(k + 1, following)
            between = (rest[-1].inv() * following).as_rotvec()
            share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(MOVE) + 1) / MOVE)
            attitude += [rest, rest[-1] * Rotation.from_rotvec(share[:, None] * between)]
            position += [k] * REST + [-1] * MOVE
            pose = following
        self.position = np.array(position)
        path = Rotation.concatenate(attitude)
        steps = (path[:-1].inv() * path[1:]).as_rotvec()
        rate = np.concatenate([np.zeros((1, 3)), steps]) * RATE
        force = path.inv().apply([0.0, 0.0, G])
        self.accel = force + ACCEL * rng.standard_normal(force.shape)
        self.gyro = rate + GYRO_BIAS + GYRO * rng.standard_normal(rate.shape)

    def recording(self, labelled=True):
        return Recording(
            time=np.arange(len(self.accel)) / RATE, accel=self.accel, gyro=self.gyro,
            position=self.position if labelled else None,
        )  # fmt: skip

    def campaign(self, labelled=True):
        return Campaign(
            (self.recording(labelled),),
            Site(G),
            Rig(),
            ModelChoice("invariant", "static", False, 0),
        )


def tap(hand, row, size=15.0, rng=None):
    """A ringing of 15 Hz that dies out in 40 ms, `size` sigma of either triad."""
    t = np.arange(40) / RATE
    ring = size * np.exp(-t / 0.04) * np.cos(2 * np.pi * 15 * t)
    hand.accel[row : row + 40] += ACCEL * ring[:, None] * [0.6, 0.0, 0.8]
    hand.gyro[row : row + 40] += GYRO * ring[:, None] * [0.8, -0.6, 0.0]


def slip(angle, row=400, length=20):
    """A smooth turn by `angle` (rad) about x, then about y where x is up: across gravity in most poses."""
    u = np.clip((np.arange(REST) - row) / length, 0.0, 1.0)
    return (3 * u**2 - 2 * u**3)[:, None] * angle * np.array([0.7, 0.5, -0.5])


@pytest.mark.parametrize("labelled", [True, False])
def test_quiet_rests_have_nothing_left_out(labelled):
    found = segment(Hand(np.random.default_rng(1)).recording(labelled))
    assert found.num_segments == 12 and found.disturbances == ()
    assert left_out_sentence(()) is None and kept_sentence(()) is None


@pytest.mark.parametrize("labelled", [True, False])
def test_a_tap_is_cut_out_of_its_rest(labelled):
    hand = Hand(np.random.default_rng(2))
    row = 5 * (REST + MOVE) + 350
    tap(hand, row)
    found = segment(hand.recording(labelled))
    (one,) = found.disturbances
    assert one.kind == "knock" and one.left_out and one.position == 5
    assert one.start <= row / RATE and row / RATE + 0.1 < one.end < row / RATE + 1.0
    assert not found.used[row : row + 10].any() and found.used[row - 100] and found.used[row + 100]
    assert found.num_segments == 12  # the rest stays one rest
    first, last, owner = found.runs()
    assert len(first) == 13 and np.sum(owner == 5) == 2
    assert left_out_sentence(found.disturbances).startswith("Handling: 1 knock left out, 0.")  # s


def test_a_dwell_is_the_mean_of_what_is_left_and_blocks_are_cuts_of_the_same_rows():
    hand = Hand(np.random.default_rng(3))
    row = 7 * (REST + MOVE) + 500
    tap(hand, row, size=40.0)
    campaign = hand.campaign()
    dwells, blocks = reduce_to_dwells(campaign.recordings), cut(join(campaign))
    used = segment(campaign.recordings[0]).used
    mine = np.flatnonzero(used & (hand.position == 7))
    assert REST - 100 < len(mine) < REST
    np.testing.assert_allclose(dwells.accel[7], hand.accel[mine].mean(axis=0), rtol=1e-12)
    assert dwells.count[7] == len(mine)
    covered = np.concatenate([np.arange(a, b) for a, b in zip(blocks.start, blocks.stop)])
    np.testing.assert_array_equal(covered, np.flatnonzero(used))
    assert len(np.unique(blocks.dwell)) == dwells.num_dwells == 12


def _one_rest(force, rate, seed=6):
    """A rest of 8 s with z up to which `force` (m/s²) and `rate` (rad/s) are added from row 400 on."""
    rng = np.random.default_rng(seed)
    accel = [0.0, 0.0, G] + ACCEL * rng.standard_normal((REST, 3))
    gyro = GYRO_BIAS + GYRO * rng.standard_normal((REST, 3))
    accel[400:] += force
    gyro[400 : 400 + len(rate)] += rate
    return [(accel, gyro)]


def test_a_jump_of_both_triads_outputs_is_no_slip():
    """A force that changes its length, too; and a rate that stays, whose beginning integrates to a turn of 3 mrad."""
    turn, pulse = 2e-2, 0.1  # rad about x; s
    across = np.array([0.0, turn * G, 0.0])
    rates = np.full((round(pulse * RATE), 1), turn / pulse) * [1.0, 0.0, 0.0]
    assert slips(_one_rest(across, rates), 1.0 / RATE) != [None]  # a turn
    # As much of |a| as of its direction.
    assert slips(_one_rest(across + [0.0, 0.0, turn * G], rates), 1.0 / RATE) == [None]
    lasting = np.full((REST - 400, 1), np.deg2rad(1.5)) * [1.0, 0.0, 0.0]
    small = np.array([0.0, 3e-3 * G, 0.0])
    assert slips(_one_rest(small, lasting), 1.0 / RATE) == [None]


@pytest.mark.parametrize("degrees", [0.6, 1.0, 2.0])
def test_the_shorter_side_of_a_slip_is_left_out(degrees):
    hand = Hand(np.random.default_rng(4), turns={4: slip(np.deg2rad(degrees), row=500)})
    (one,) = segment(hand.recording()).disturbances
    assert one.kind == "slip" and one.position == 4
    begin = 4 * (REST + MOVE)
    assert abs(one.start - (begin + 500) / RATE) < 0.5
    found = segment(hand.recording())
    assert found.start[4] == begin and begin + 440 < found.stop[4] <= begin + 500
    assert one.end == (begin + REST) / RATE  # what goes with the slip counts as left out


@pytest.mark.parametrize(("degrees", "row", "parts"), [(0.4, 420, 2), (0.5, 540, 1)])
def test_both_sides_of_a_slip_are_rests_where_rests_were_found(degrees, row, parts):
    """2.8 s on the shorter side are a rest; less than 2 s are none and count as left out with the slip."""
    hand = Hand(np.random.default_rng(4), turns={4: slip(np.deg2rad(degrees), row=row)})
    found = segment(hand.recording(labelled=False))
    begin = 4 * (REST + MOVE)
    mine = (found.start >= begin - MOVE // 2) & (found.stop <= begin + REST + MOVE // 2)
    assert mine.sum() == parts and found.num_segments == 11 + parts
    assert np.all(np.diff(found.start) > 0) and len(set(found.position)) == 11 + parts
    (one,) = found.disturbances
    assert one.kind == "slip" and (one.end - one.start < 1.0) == (parts == 2)
    assert not np.any((found.start < begin + row + 10) & (found.stop > begin + row + 10))
    if parts == 2:
        before, after = (slice(a, b) for a, b in zip(found.start[mine], found.stop[mine]))
        up = [x.mean(axis=0) for x in (hand.accel[before], hand.accel[after])]
        seen = np.arctan2(np.linalg.norm(np.cross(*up)), np.dot(*up))
        noise = ACCEL / G * np.sqrt(2.0 / 280.0)  # of the angle between two means, rad
        turned = Rotation.from_rotvec(np.deg2rad(degrees) * np.array([0.7, 0.5, -0.5])).magnitude()
        assert 0.2 * turned < seen < turned + 4.0 * noise  # poses of their own: the turn across up


def test_a_rest_held_by_hand_counts_for_the_magnitude_of_the_force_alone():
    """A tremor of 3 Hz turns the device by 1 mrad, of which |a| sees half the square."""
    tremor = 1e-3 * np.sin(2 * np.pi * 3.0 * np.arange(REST) / RATE)[:, None] * [0.6, -0.6, 0.5]
    hand = Hand(np.random.default_rng(11), turns={5: tremor})
    recording = hand.recording(labelled=False)
    left = segment(recording)
    assert [d.kind for d in left.disturbances] == ["held"] and left.num_segments == 11
    kept = segment(recording, held=True)
    assert [d.force_kept for d in (*left.disturbances, *kept.disturbances)] == [False, True]
    again = kept.without_held()  # what gyros and magnetometers are calibrated by
    for name in ("start", "stop", "position", "used"):
        np.testing.assert_array_equal(getattr(again, name), getattr(left, name))
    log = join(hand.campaign(labelled=False))
    blocks = cut(log)
    held = blocks[blocks.held]
    assert held.num_blocks == 1 and len(np.unique(blocks.dwell)) == 12
    assert abs(np.linalg.norm(held.accel[0]) - G) < 5 * ACCEL / np.sqrt(REST)
    # The larger one of what samples tell and of what eight parts do, χ²₇/7, is above 3 in 0.4 % of draws.
    assert 0.8 < held.accel_white[0].mean() / (ACCEL**2 / held.count[0]) < 3.0
    form = lambda triad, estimator: ModelForm(triad, estimator, 0, (), 0.0, 1.0, G)
    assert usable(form("accel", "invariant"), blocks).all()
    assert not usable(form("gyro", "static"), blocks)[blocks.held].any()


@pytest.mark.slow
def test_a_direction_that_a_hand_held_alone_is_not_lost_to_the_accelerometers():
    """The one rest at -z trembles by 1 mrad: its |a| is as good as any other's, and nothing else tells that bias.

    The gyros' rests and the motions between them are those without that rest.
    """
    tremor = 1e-3 * np.sin(2 * np.pi * 3.0 * np.arange(REST) / RATE)[:, None] * [0.6, -0.6, 0.5]
    poses = {k: r for k, r in enumerate(Rotation.random(12, np.random.default_rng(3)))}
    up = np.array([r.inv().apply([0.0, 0.0, 1.0]) for r in poses.values()])
    for k in np.flatnonzero(up[:, 2] < 0.1):  # but for one, no rest has its z axis down
        poses[k] = poses[k] * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    poses[5] = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    hand = Hand(np.random.default_rng(11), turns={5: tremor}, poses=poses)
    bias = np.array([0.05, -0.08, 0.12])
    hand.accel += bias
    campaign = hand.campaign(labelled=False)
    campaign = replace(campaign, model=replace(campaign.model, gyro_estimator="gravity"))
    (result,) = calibrate(campaign)
    assert result.accel.dwells.num_dwells == 12
    assert any("counts for the accelerometers' |a| alone" in c for c in result.choices)
    assert not any("left out" in c for c in result.choices if c.startswith("Handling"))
    found = result.calibration.accel
    sigma = np.sqrt(np.diag(found.covariance))[:3]
    error = np.asarray(found.curve.coefficients)[0, :3] - bias
    assert np.all(np.abs(error) < 4.0 * sigma)

    segments = tuple(s.without_held() for s in result.segments)
    without = calibrate_device(campaign, segments=segments)
    lost = np.sqrt(np.diag(without.calibration.accel.covariance))[2]
    assert sigma[2] < lost / 3.0
    for of in (lambda d: d.rows[:, :3], lambda d: d.gyro, lambda d: d.gyro_covariance):
        np.testing.assert_allclose(
            of(result.gyro.dwells), of(without.gyro.dwells), rtol=1e-12, atol=1e-15
        )
    again = calibrate_device(campaign, segments=result.segments)
    assert np.array_equal(found.covariance, again.calibration.accel.covariance)


def test_the_variance_of_a_rest_by_its_parts_is_that_of_its_mean():
    """White noise, whose mean's variance is known, and a tremor of half the rest, whose samples say too little."""
    rng = np.random.default_rng(8)
    start = 800 * np.arange(400)
    white = rng.standard_normal((320_000, 3))
    found = variance_by_parts(white, start, start + 800)
    # Each is χ²₇/7 of 1/800, whose variance is 2/7: of 1200 of them the mean is within 4 sigma.
    assert abs(found.mean() * 800.0 - 1.0) < 4.0 * np.sqrt(2.0 / 7.0 / 1200.0)
    phase = rng.uniform(0.0, 2.0 * np.pi, 400)
    slow = np.sin(2.0 * np.pi * np.arange(800) / 1600.0 + phase[:, None]).reshape(-1, 1) * np.ones(
        3
    )
    means = np.square(slow.reshape(400, 800, 3).mean(axis=1)).mean()
    assert variance_by_parts(slow, start, start + 800).mean() > 50.0 * 0.5 / 800.0
    assert means > 0.1  # and even that is less than what half a period does to a mean
    assert not variance_by_parts(white, np.array([5]), np.array([20])).any()


def test_what_only_one_triad_shows_is_no_handling():
    hand = Hand(np.random.default_rng(5))
    begin = 3 * (REST + MOVE)
    hand.accel[begin + 400 : begin + REST, 1] += 0.05  # a jump of a bias: 0.3 deg, and no rate
    hand.gyro[begin + REST + MOVE : begin + 2 * REST + MOVE, 0] += (
        2e-3  # a bias that differs in one rest
    )
    assert segment(hand.recording()).disturbances == ()


def test_a_rest_that_tilts_slowly_is_left_out():
    turn = np.linspace(0.0, 1.0, REST)[:, None] * np.deg2rad(0.5) * np.array([0.7, 0.5, -0.5])
    found = segment(Hand(np.random.default_rng(6), turns={2: turn}).recording())
    (one,) = found.disturbances
    assert (one.kind, one.position, one.left_out) == ("slow tilt", 2, True)
    assert list(found.position) == [0, 1, *range(3, 12)]


@pytest.mark.slow
def test_where_every_rest_tilts_all_stay_and_the_calibration_warns():
    turn = np.linspace(0.0, 1.0, REST)[:, None] * np.deg2rad(0.5) * np.array([0.7, 0.5, -0.5])
    hand = Hand(np.random.default_rng(7), turns=dict.fromkeys(range(12), turn))
    found = segment(hand.recording())
    assert found.num_segments == 12
    assert {d.kind for d in found.disturbances} == {"slow tilt"} and len(found.disturbances) >= 11
    assert not any(d.left_out for d in found.disturbances)
    (result,) = calibrate(hand.campaign())
    assert any("tilt slowly kept" in w for w in result.warnings)
    assert len(result.handling) == len(found.disturbances)


def test_the_tilt_that_is_said_is_the_turn_across_gravity():
    turn = np.linspace(0.0, 1.0, REST)[:, None] * np.deg2rad(1.0) * np.array([1.0, 0.0, 0.0])
    hand = Hand(np.random.default_rng(8), rests=6, turns={3: turn})
    rests = [slice(k * (REST + MOVE), k * (REST + MOVE) + REST) for k in range(6)]
    marked, angle = tilting([(hand.accel[r], hand.gyro[r]) for r in rests], 1.0 / RATE)
    up = hand.accel[rests[3]].mean(axis=0) / G
    across = np.deg2rad(1.0) * np.hypot(up[1], up[2])
    assert list(marked) == [False] * 3 + [True] + [False] * 2
    # A slope of 800 samples of 0.02 m/s² over 8 s: 0.02 sqrt(12 / 800) / 9.81 = 2.5e-4 rad; four of them.
    assert angle[3] == pytest.approx(across, abs=1e-3)


@pytest.mark.parametrize("early", [10, 30, 100])
def test_labels_that_come_early_lose_the_samples_of_the_slew(early):
    hand = Hand(np.random.default_rng(9))
    hand.position = np.r_[hand.position[early:], np.full(early, -1)]
    found = segment(hand.recording())
    assert found.num_segments == 12
    truly = np.arange(12) * (REST + MOVE)
    # The turn's last hundredths of a second are slower than 0.02 rad/s; the first rest has none before it.
    assert np.all(found.start[1:] >= truly[1:] - 4) and np.all(found.start[1:] < truly[1:] + 80)
    assert {d.kind for d in found.disturbances} == {"not at rest"} and len(found.disturbances) == 11
    dwells = reduce_to_dwells([hand.recording()])
    white = ACCEL**2 / np.asarray(dwells.count)
    variance = np.einsum("kii->ki", dwells.accel_covariance)
    assert np.all(variance < 3.0 * white[:, None])


def test_settling_after_a_move_is_no_motion():
    rng = np.random.default_rng(10)
    course = np.exp(-np.arange(REST) / 100.0)[:, None]
    accel = np.array([0.0, 0.0, G]) + 0.05 * course + 1e-3 * rng.standard_normal((REST, 3))
    gyro = 5e-3 * course + 1e-4 * rng.standard_normal((REST, 3))
    assert quiet_part(accel, gyro, 1.0 / RATE) == (0, REST)
    assert quiet_part(accel, None, 1.0 / RATE) == (0, REST)


def test_a_drift_over_a_long_rest_is_no_motion():
    rng = np.random.default_rng(11)
    rows = 4000
    gyro = np.linspace(-0.1, 0.1, rows)[:, None] + 1e-3 * rng.standard_normal((rows, 3))
    assert quiet_part(None, gyro, 1.0) == (0, rows)


def test_spikes_of_one_channel_are_left_out_one_by_one():
    hand = Hand(np.random.default_rng(12))
    rows = np.flatnonzero(hand.position >= 0)[37::160]
    rows = rows[np.isin(rows % (REST + MOVE), np.arange(10, REST - 10))]
    hand.accel[rows, 2] += 1.0
    found = segment(hand.recording())
    assert len(rows) > 50 and not found.used[rows].any()
    kinds = [d.kind for d in found.disturbances]
    # Now and then the gyros' noise is high beside one, and both together look like a knock: 60 times 1.3e-3 times the
    # windows of three lengths that hold the spike, some ten of which are independent.
    assert kinds.count("spike") >= len(rows) - 5 and set(kinds) <= {"spike", "knock"}
    assert (~found.used & (hand.position >= 0)).sum() < 60 * 5 + 2 * len(rows)


def test_a_coarse_converter_has_no_spikes():
    rng = np.random.default_rng(13)
    values = np.round(0.2 * rng.standard_normal((2000, 3)))  # mostly zero, sometimes one step
    assert not spiked(levels_of(values, 0.01, np.ones(3))).any()


def test_a_clipped_rest_is_left_out_and_said():
    hand = Hand(np.random.default_rng(14))
    limit = np.sort(np.abs(hand.accel[hand.position >= 0][:, 0]))[-REST // 2]
    hand.accel[:, 0] = np.clip(hand.accel[:, 0], -limit, limit)
    found = segment(hand.recording())
    assert {d.kind for d in found.disturbances} == {"clipped"} and found.num_segments < 12
    assert "clipped rest" in left_out_sentence(found.disturbances)


def test_a_quiet_channel_of_a_coarse_converter_is_not_clipped():
    rng = np.random.default_rng(15)
    start = np.arange(6) * 100
    values = np.repeat(rng.integers(-50, 50, (6, 3)).astype(float), 100, axis=0)
    assert not clipped(values, start, start + 100).any()


def test_energy_of_a_window_is_a_standard_normal_deviate():
    # Outside value: the same tail probability by SciPy's chi-square and normal distributions.
    width = 11
    energy = np.ones(1000)  # of a chi² with one degree of freedom, whose mean is one
    rng = np.random.default_rng(16)
    energy = rng.chisquare(1.0, 200_000)
    bursts = Bursts(energy, 1.0, width)
    deviates = bursts.at(slice(None))
    assert np.array_equal(bursts.above(2.0), np.flatnonzero(deviates > 2.0))
    for z in (-1.0, 0.0, 1.0, 2.0, 3.0):
        share = np.mean(deviates > z)
        # Neighbours share rows: 200 000 / 11 independent windows, four standard deviations.
        expected = norm.sf(z)
        assert share == pytest.approx(expected, abs=4 * np.sqrt(expected / (200_000 / 11)) + 0.004)
    largest = chi2.ppf(norm.cdf(4.0), width) / width
    spread = 2 / (9 * width)
    assert (np.cbrt(largest) - 1 + spread) / np.sqrt(spread) == pytest.approx(4.0, abs=0.06)


@pytest.mark.slow
def test_calibration_and_diagnosis_leave_out_the_same_and_both_are_right():
    hand = Hand(np.random.default_rng(17), rests=24, turns={11: slip(np.deg2rad(2.0))})
    for k in (3, 8, 15):
        tap(hand, k * (REST + MOVE) + 300, size=60.0)
    campaign = hand.campaign()
    (result,) = calibrate(campaign)
    assert [d.kind for d in result.handling] == ["knock", "knock", "slip", "knock"]
    assert result.handling == join(campaign).segments.disturbances
    assert any(c.startswith("Handling: 3 knocks, 1 slip left out") for c in result.choices)
    bias = np.asarray(result.gyro.solution.curve(20.0)[:3])
    # 24 rests of 8 s at 1e-3 rad/s a sample: 1e-3 / sqrt(24 * 800) = 7e-6 rad/s; five of them.
    np.testing.assert_allclose(bias, GYRO_BIAS, atol=4e-5)


@pytest.mark.slow
def test_diagnosis_is_consistent_with_what_is_left():
    from inertiax.diagnose import diagnose
    from inertiax.effects import CATALOGUE

    hand = Hand(np.random.default_rng(18), rests=14)
    for k in (3, 8, 12):
        tap(hand, k * (REST + MOVE) + 300, size=60.0)
    # What a knock that was overlooked would be taken for; `test_real_recordings.py` tries the whole catalogue on logs
    # with knocks.
    alike = [e for e in CATALOGUE if e.name in ("bias_step", "settling", "drift", "warm_up")]
    found = diagnose(hand.campaign(), effects=alike)
    assert found.verdict == "consistent"
    assert [d.kind for d in found.handling] == ["knock"] * 3
    assert "Handling: 3 knocks left out" in found.summary
    assert [d["kind"] for d in found.as_dict()["handling"]] == ["knock"] * 3


def test_rests_found_before_are_kept_where_outputs_have_been_changed_since():
    """What is taken away from the gyros may shift which moments look like rest; accelerometers do not know of it."""
    hand = Hand(np.random.default_rng(21))
    before = hand.campaign(labelled=False)
    plain = calibrate_device(before)
    rest = 3 * (REST + MOVE)
    hand.gyro[rest : rest + REST : 40, 0] += 0.2  # a correction that does not suit one rest
    after = hand.campaign(labelled=False)
    coefficients = lambda found: np.asarray(found.calibration.accel.curve.coefficients)
    anew = calibrate_device(after)
    assert not np.array_equal(coefficients(anew), coefficients(plain))  # a rest is lost
    again = calibrate_device(after, model=plain.model, segments=plain.segments)
    np.testing.assert_array_equal(coefficients(again), coefficients(plain))


def test_quiet_stretches_that_are_too_short_for_rests_are_counted():
    rng = np.random.default_rng(8)
    moving = lambda seconds: np.ones(round(seconds * RATE), bool)
    parts = [[~moving(5.0), moving(3.0)] for _ in range(8)]
    short = [[~moving(1.6), moving(3.0)] for _ in range(3)]
    moves = np.concatenate([x for part in (*parts, *short) for x in part])
    shaken = moves[:, None] * rng.standard_normal((len(moves), 3))
    force = [0.0, 0.0, G] + 2.0 * shaken + ACCEL * rng.standard_normal(shaken.shape)
    recording = Recording(time=np.arange(len(moves)) / RATE, accel=force)
    found = find_rests(recording, window=1.0)
    assert len(found.start) == 8 and "; 3 stretches as quiet" in found.statement
    longer = Recording(time=recording.time[:6400], accel=force[:6400])
    assert "as quiet" not in find_rests(longer, window=1.0).statement


@pytest.mark.parametrize("shortest, longest, long", [(1.1, 2.0, 0), (2.5, 4.0, 0), (1.1, 1.2, 3)])
def test_a_hand_that_rests_for_a_second_at_a_time_rests_as_often_as_it_does(
    shortest, longest, long
):
    """In a log of rests of 1.1 to 2 s a third of them was found, and eleven of them told no misalignment; in one of
    41 pauses of 1.1 s the three that were longer."""
    rng = np.random.default_rng(4)
    moving, force = np.zeros(0, bool), np.zeros((0, 3))
    for k in range(25):
        seconds = 5.0 if k < long else rng.uniform(shortest, longest)
        still, move = round(seconds * RATE), round(1.2 * RATE)
        moving = np.concatenate([moving, np.zeros(still, bool), np.ones(move, bool)])
        pose = np.tile(G * Rotation.random(None, rng).as_matrix()[0], (still + move, 1))
        force = np.concatenate([force, pose])
    shaken = moving[:, None] * rng.standard_normal((len(moving), 3))
    force = force + 2.0 * shaken + ACCEL * rng.standard_normal(shaken.shape)
    found = segment(Recording(time=np.arange(len(moving)) / RATE, accel=force))
    assert found.num_segments == 25
    assert not any(moving[a:b].any() for a, b in zip(found.start, found.stop))


@pytest.mark.parametrize("last", [500, 900])
def test_the_pause_behind_a_rest_is_not_counted_as_rest(last):
    """5 s of rows from 0 s, a pause of 1000 s, 4 s of rows: the first rest ends with its rows, as does the second."""
    time = np.concatenate([np.arange(500), 100_500 + np.arange(400)]) / RATE
    recording = Recording(time=time, accel=np.tile([0.0, 0.0, G], (900, 1)))
    first = last - 400
    left = Undisturbed(
        np.array([first]), np.array([last]), np.zeros(1, int), np.ones(900, bool), ()
    )
    held = left.noted(recording, "held", 0, first, last)
    assert held.end - held.start == pytest.approx(4.0, abs=0.011)
    if last == 500:
        assert str(left_out_sentence([held])).endswith(" left out, 4 s of rest in all.")
