"""The plain answer to "is it good?", on calibrations that are and that are not."""

import equinox as eqx
import numpy as np
import pytest

from inertiax.calibrate.data_coverage import empty_cone
from inertiax.calibrate.fit_quality import _of_one_wish, judge, Quality, TriadVerdict
from inertiax.calibrate.goodness_of_fit import (
    ATTENTION,
    FINE,
    grade_misfit,
    grade_parameters,
    UNUSABLE,
)
from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose import diagnose_campaign
from inertiax.report.calibration import _beside


G = 9.81


def _campaign(forces, *, flip=None, kick=None, noise=2e-3, scale=1.0, seed=0) -> Campaign:
    """Rests of 2 s at 100 Hz with the given true forces on a triad of 1 % errors.

    Tests take 23 or 24 rests, so that all share what is compiled for 24.
    """
    rng = np.random.default_rng(seed)
    matrix = np.array([[1.01, 0, 0], [0.004, 0.99, 0], [-0.003, 0.006, 1.008]]) * scale
    if flip is not None:
        matrix[flip] *= -1.0
    output = np.asarray(forces) @ matrix.T + [0.05, -0.02, 0.1]
    if kick is not None:
        output[kick] += [0.0, 0.3, 0.0]
    rows = np.repeat(output, 200, axis=0)
    recording = Recording(
        time=np.arange(len(rows)) * 0.01,
        accel=rows + noise * rng.normal(size=rows.shape),
        position=np.repeat(np.arange(len(output)), 200),
        reference_accel=np.repeat(forces, 200, axis=0),
    )
    return Campaign((recording,), Site(gravity=G))


def _directions(number: int) -> np.ndarray:
    draws = np.random.default_rng(1).normal(size=(number, 3))
    return draws / np.linalg.norm(draws, axis=1, keepdims=True)


def _judged(campaign: Campaign, *, force: bool = False) -> tuple[Quality, DeviceResult]:
    (result,) = calibrate(campaign, method="joint", force=force)
    assert isinstance(result, DeviceResult), result
    return judge(result), result


def test_a_good_calibration_is_called_good():
    quality, _ = _judged(_campaign(G * _directions(24)))
    assert quality.verdict == "good" and quality.answer.startswith("Good")
    topics = {f.topic for f in quality.findings}
    assert {"misfit", "orientations", "weakest"} <= topics
    assert all(f.fine for f in quality.findings)


@pytest.mark.slow
def test_outputs_without_any_noise_are_calibrated_all_the_same():
    # Without noise the weights are equal; rounding, taken for scatter, would be no unit to converge in.
    quality, result = _judged(_campaign(G * _directions(24), noise=0.0))
    assert result.accel is not None and result.accel.rms < 1e-12
    assert quality.verdict == "good" and "the noise itself is not known" in quality.findings[0].text


def test_an_axis_of_the_wrong_sign_is_a_mistake():
    quality, _ = _judged(_campaign(G * _directions(24), flip=1), force=True)
    assert quality.verdict == "doubtful"
    assert "accel y is mirrored" in quality.answer
    assert any("axis y has the wrong sign" in f.text for f in quality.findings)


def test_a_wrong_unit_is_a_mistake():
    # Twice the truth: beyond any sensor's scale-factor error, so that only `force` calibrates at all.
    quality, _ = _judged(_campaign(G * _directions(24), scale=2.0), force=True)
    assert quality.verdict == "doubtful" and "2 times what it should be" in quality.answer
    assert any("reads 2.02 times the truth" in f.text for f in quality.findings)


def test_a_rest_that_was_touched_is_named_by_its_time():
    quality, _ = _judged(_campaign(G * _directions(24), kick=7))
    (rest,) = [f for f in quality.findings if f.topic == "rests"]
    assert not rest.fine and "1 of 24 dwells" in rest.text
    assert "at 15 s" in rest.text  # the middle of the eighth rest of 2 s
    assert quality.verdict == "usable"


def test_as_many_rests_as_parameters_are_no_test_of_the_fit():
    """Six faces tell six parameters to the last digit, whatever the device lacks beside them."""
    six = np.concatenate([np.eye(3), -np.eye(3)])
    campaign = _campaign(G * six)
    (recording,) = campaign.recordings
    alone = eqx.tree_at(lambda r: r.reference_accel, recording, None)
    quality, result = _judged(Campaign((alone,), campaign.site))
    assert result.accel.dwells.num_dwells == len(result.accel.estimator.names) == 6
    assert quality.verdict == "usable"
    (told,) = [f.text for f in quality.findings if f.topic == "redundancy"]
    assert "6 equations tell 6 parameters" in told
    read = G * six + [0.05, -0.02, 0.1] + 2e-3 * np.random.default_rng(5).normal(size=(6, 3))
    rows = Recording(time=np.arange(6.0), accel=read, position=np.arange(6))
    quality, result = _judged(Campaign((rows,), Site(gravity=G)))
    (told,) = [f.text for f in quality.findings if f.topic == "redundancy"]
    assert "no row tells its noise" in told
    bias = np.sqrt(np.diag(result.calibration.accel.covariance))[:3]
    np.testing.assert_allclose(bias, 1e-3 / np.sqrt(2.0), rtol=0.2)  # of two faces, by 1 mm/s² each
    more = _campaign(G * np.concatenate([six, _directions(2)]))
    (longer,) = more.recordings
    longer = eqx.tree_at(lambda r: r.reference_accel, longer, None)
    quality, _ = _judged(Campaign((longer,), more.site))
    assert not [f for f in quality.findings if f.topic == "redundancy"]
    found, _ = diagnose_campaign(Campaign((alone,), campaign.site))
    assert "6 rests tell 6 parameters and leave none to test them by" in found.summary


def test_a_range_that_ends_below_gravity_is_the_reservation():
    campaign = _campaign(G * _directions(24))
    (recording,) = campaign.recordings
    ended = recording.accel.copy()
    ended[:, 0] = np.clip(ended[:, 0], -7.85, 7.85)  # 0.8 g
    cut = eqx.tree_at(lambda r: r.accel, recording, ended)
    quality, _ = _judged(Campaign((cut,), campaign.site))
    assert (
        quality.verdict == "usable"
        and "accel_x ends at 7.85 and −7.85 m/s² at rest" in quality.answer
    )


def test_rests_of_one_pose_that_differ_by_many_times_their_noise_are_no_silent_success():
    rng = np.random.default_rng(2)
    level = np.repeat(0.05 * rng.standard_normal((5, 3)), 200, axis=0)
    recording = Recording(
        time=np.arange(1000) / 100.0,
        accel=[0.0, 0.0, G] + level + 0.01 * rng.standard_normal((1000, 3)),
        gyro=1e-3 * rng.standard_normal((1000, 3)),
        position=np.repeat(np.arange(5), 200),
    )
    quality, result = _judged(Campaign((recording,), Site(gravity=G)))
    spread = np.sqrt(np.mean((level - level.mean(axis=0)) ** 2))
    (said,) = [f.text for f in quality.findings if f.topic == "misfit" and f.text[0] == "A"]
    assert f"rests of one pose differ by {spread:.2g}"[:-1] in said and "outputs wandered" in said
    assert quality.verdict == "usable" and said[1:] in quality.answer  # the gyros' biases are


def test_what_to_record_next_is_the_orientation_that_is_missing():
    # Every orientation but those with z down.
    forces = _directions(60)
    forces = G * forces[forces[:, 2] > -0.2][:23]
    quality, result = _judged(_campaign(forces))
    (found,) = [f for f in quality.findings if f.topic == "orientations"]
    assert not found.fine
    (wanted,) = quality.next
    assert "a rest" in wanted and "−z" in wanted
    # And recording it does what is promised: the least certain parameter becomes more certain.
    assert result.accel is not None
    more = np.concatenate([forces, [[0.0, 0.0, -G]]])
    still, after = _judged(_campaign(more))
    assert still.next == ("Accelerometers: another rest with −z up.",)  # one among 23 is little
    worst = lambda r: float(np.sqrt(np.diagonal(np.asarray(r.accel.solution.covariance))).max())
    assert worst(after) < 0.95 * worst(result)


def test_a_gap_in_temperature_is_told():
    forces = G * np.tile(_directions(12), (2, 1))
    campaign = _campaign(forces)
    (recording,) = campaign.recordings
    probe = np.where(np.arange(recording.num_samples) < recording.num_samples // 2, -20.0, 50.0)
    ramp = np.linspace(0.0, 4.0, recording.num_samples)
    warmed = eqx.tree_at(
        lambda r: r.temperature, recording, (probe + ramp)[:, None], is_leaf=lambda x: x is None
    )
    campaign = Campaign((warmed,), campaign.site, model=ModelChoice(temperature_degree=1))
    quality, _ = _judged(campaign)
    (found,) = [f for f in quality.findings if f.topic == "temperature"]
    assert not found.fine and "nothing between -18 and 52 °C" in found.text
    assert any("an experiment at about 17 °C" in n for n in quality.next)


def test_what_two_triads_share_is_said_once():
    """By hand: one wish of both triads is a line, one of its own stays, and the page repeats no reason."""
    same, own = "an experiment at about 17 °C.", "a rest with +x up."
    advice = [
        f"Accelerometers: {same}",
        f"Accelerometers: {own}",
        f"Gyros: {same}",
        "A log by hand.",
    ]
    assert _of_one_wish(advice) == (
        f"Accelerometers and gyros: {same}", f"Accelerometers: {own}", "A log by hand.",
    )  # fmt: skip
    why = "nothing between -18 and 52 °C."
    triads = [TriadVerdict(n, "usable", f"{n}: usable; {why}") for n in ("Accelerometers", "Gyros")]
    triads.append(TriadVerdict("Magnetometers", "good", "Magnetometers: good; 1 nT is left."))
    quality = Quality("usable", f"Usable: accelerometers: {why}", (), (), tuple(triads))
    assert _beside(quality) == ["Gyros: the same.", "Magnetometers: good; 1 nT is left."]


@pytest.mark.parametrize(
    "directions, angle",
    [
        (np.array([[0.0, 0.0, 1.0]]), 180.0),
        (np.concatenate([np.eye(3), -np.eye(3)]), np.rad2deg(np.arccos(3**-0.5))),
    ],
)
def test_the_largest_empty_cone_by_hand(directions, angle):
    found, axis = empty_cone(directions)
    assert abs(found - angle) < 8.0  # the grid's spacing
    assert np.max(directions @ axis) < np.cos(np.deg2rad(angle - 10.0))


def test_exchanged_positions_are_not_to_be_used():
    forces = G * _directions(24)
    campaign = _campaign(forces)
    (recording,) = campaign.recordings
    wrong = forces.copy()
    wrong[[3, 11]] = forces[[11, 3]]
    mixed = eqx.tree_at(lambda r: r.reference_accel, recording, np.repeat(wrong, 200, axis=0))
    campaign = Campaign((mixed,), campaign.site, model=ModelChoice(accel_estimator="reference"))
    quality, result = _judged(campaign, force=True)
    assert result.accel is not None and result.accel.rms > 1.0
    assert quality.verdict == "doubtful" and "positions are exchanged" in quality.answer
    (triad,) = quality.triads
    assert triad.text.startswith("Accelerometers: do not use it yet;")


@pytest.mark.parametrize(
    "unit, rms, ratio, grade",
    [
        ("m/s^2", 1e-3, 1.0, FINE),
        ("m/s^2", 1e-3, np.nan, FINE),  # the noise is not known
        ("m/s^2", 4e-3, 7.8, ATTENTION),
        ("m/s^2", 1e-4, 1000.0, ATTENTION),  # a navigation sensor's missing physics
        ("m/s^2", 0.05, 150.0, UNUSABLE),
        ("m/s^2", 1.55, np.nan, UNUSABLE),  # exchanged positions
        ("rad/s", 1e-4, 1.9, FINE),
        ("rad/s", 0.2, 2.0, UNUSABLE),
        ("rad", 0.01, 2.0, FINE),
        ("rad", 0.4, 20.0, UNUSABLE),
        ("m/s^2", np.nan, np.nan, UNUSABLE),
    ],
)
def test_misfits_are_graded_by_noise_and_by_size(unit, rms, ratio, grade):
    assert grade_misfit(unit, rms, ratio) == grade
    # A fleet's devices at once, as one alone.
    many = grade_misfit(unit, np.array([rms, 1e-9]), np.array([ratio, 1.0]))
    assert many.tolist() == [grade, FINE]


@pytest.mark.parametrize(
    "name, value, sigma, grade",
    [
        ("accel.matrix[1,0]", 0.040, 0.071, UNUSABLE),  # 40000 ± 71000 µrad
        ("accel.matrix[1,0]", 0.004, 0.005, ATTENTION),
        ("accel.matrix[1,0]", 0.030, 0.005, FINE),  # six sigma of its value
        ("accel.matrix[1,0]", 0.0, 0.0002, FINE),  # a fiftieth of the usual size
        ("gyro.bias[2]", 0.02, 0.0001, FINE),
        ("gyro.g_sensitivity[0,1]", 0.0, 0.02, UNUSABLE),
        ("accel.bias[0]", 0.1, np.nan, UNUSABLE),
    ],
)
def test_a_parameter_is_fine_only_where_its_sigma_is_small(name, value, sigma, grade):
    assert grade_parameters((name,), np.array([value]), np.array([sigma])).tolist() == [grade]


@pytest.mark.parametrize("apart", [True, False])
def test_two_recordings_of_one_temperature_each_do_not_part_switching_on_from_temperature(apart):
    one = _campaign(G * _directions(24)).recordings[0]
    probe = lambda t, seed: t + 0.01 * np.random.default_rng(seed).normal(size=(len(one.time), 1))
    parts = [eqx.tree_at(lambda r: r.temperature, one, probe(20.0, 1), is_leaf=lambda x: x is None)]
    warm = eqx.tree_at(lambda r: r.temperature, one, probe(40.0, 2), is_leaf=lambda x: x is None)
    parts.append(eqx.tree_at(lambda r: r.time, warm, one.time + 1000.0))
    if not apart:  # one recording that holds both
        join = lambda field: np.concatenate([getattr(p, field) for p in parts])
        fields = ("time", "accel", "reference_accel", "temperature")
        parts = [
            Recording(
                **{f: join(f) for f in fields}, position=np.r_[one.position, one.position + 24]
            )
        ]
    quality, _ = _judged(
        Campaign(tuple(parts), Site(gravity=G), model=ModelChoice(temperature_degree=1))
    )
    (said,) = [f.text for f in quality.findings if f.topic == "temperature"]
    assert "nothing between 20 and 40 °C" in said and ("switched off between them" in said) is apart
