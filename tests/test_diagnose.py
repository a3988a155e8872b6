"""The diagnosis, end to end, on small campaigns written here in plain NumPy."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

from diagnose_data import behind, FLICKER, only, slow_noise, sweep, tumble
from inertiax.data.recording import Campaign, ModelChoice, Recording
from inertiax.diagnose import audit, diagnose, diagnose_model, hold_out, run_diagnosis
from inertiax.diagnose.estimates.transients import most_scattered
from inertiax.diagnose.problem import prepare
from inertiax.effects import CATALOGUE


@pytest.mark.slow
def test_a_campaign_without_omissions_is_consistent_and_says_what_it_could_have_seen():
    found = diagnose(tumble(seed=3))
    assert found.verdict == "consistent"
    assert found.effects == () and found.where == ()
    sizes = {d.name: d.size for d in found.detectable}
    # Five sigma of the mean of 24 tumbles: order 1e-5 to 1e-3 m/s²/g², well below a tactical K2.
    assert 1e-5 < sizes["second_order"] < 1e-3
    assert {"gravity_error", "supply", "g_sensitivity"} <= set(found.not_testable)


SECOND_ORDER = 8e-4  # m/s²/g²


@pytest.fixture(scope="module")
def second_order(tmp_path_factory):
    """The diagnosis of a campaign's folder, with what it has written."""
    folder = tmp_path_factory.mktemp("second_order")
    campaign = tumble(seed=4, effect=lambda f, t: only(1, SECOND_ORDER * f[:, 1] ** 2))
    recording = campaign.recordings[0]
    columns = [recording.time, *recording.accel.T, recording.position, recording.experiment]
    header = "time,accel_x,accel_y,accel_z,position,experiment"
    np.savetxt(
        folder / "log.csv",
        np.stack(columns, axis=1),
        delimiter=",",
        header=header,
        comments="",
        fmt="%.9g",
    )
    (folder / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["*.csv"]\n[model]\naccel_estimator = "invariant"\n'
        'temperature_degree = 0\n[device]\ngrade = "tactical"\n'
    )
    return run_diagnosis(folder / "campaign.toml", folder / "out"), folder / "out"


@pytest.mark.slow
def test_second_order_is_named_located_and_measured(second_order):
    found, _ = second_order
    assert found.verdict == "missing-physics"
    (effect,) = found.effects
    assert effect.name == "second_order" and effect.channels == ("accel_y",)
    (coefficient,) = [p for n, p in effect.parameters if n == "coefficient"]
    assert abs(coefficient.value - SECOND_ORDER) < 3.0 * coefficient.std
    assert {w.channel for w in found.where} == {"accel_y"}
    assert found.augmented.held_out_rms < found.baseline.held_out_rms
    assert found.augmented.chi2_per_dof == pytest.approx(
        1.0, abs=0.1
    )  # 1 ± sqrt(2/500) if noise is right


@pytest.mark.slow
def test_thermal_lag_gives_its_time_constant():
    tau = 90.0

    def lagged(probe, time):
        x, y = (probe - 20.0) / 30.0, (behind(time, probe, tau) - 20.0) / 30.0
        return only(0, 1e-4 * ((y - 0.3 * y**2) - (x - 0.3 * x**2)))

    found = diagnose(sweep(seed=5, effect=lagged, step=2.0))
    assert [e.name for e in found.effects] == ["thermal_lag"]
    assert found.effects[0].channels == ("gyro_x",)
    value = dict(found.effects[0].parameters)["time_constant"]
    assert (
        abs(value.value - tau) < 4.0 * value.std
    )  # the slope at which it acts is itself estimated
    assert {w.driver for w in found.where} == {"temperature_rate"}


@pytest.mark.slow
def test_an_effect_outside_the_catalogue_is_unexplained_and_gets_a_formula():
    found = diagnose(
        sweep(
            seed=6,
            effect=lambda probe, t: only(2, 4e-6 * np.exp(-0.5 * ((probe - 25.0) / 4.0) ** 2)),
            step=2.0,
        )
    )
    assert found.verdict == "unexplained"
    assert found.effects == ()
    assert "gyro_z" in found.empirical and "T" in found.empirical
    assert not any(e.name in found.empirical for e in CATALOGUE)


@pytest.mark.slow
def test_a_bump_in_time_between_the_grids_points_is_not_taken_for_slow_noise():
    """Its middle lies half-way between those of the grid, and its width too."""
    rng = np.random.default_rng(8)

    def effect(probe, time):
        slow = np.stack([slow_noise(rng, time) for _ in range(3)], axis=1) / FLICKER
        bump = np.exp(-0.5 * ((time - 1600.0) / 260.0) ** 2)
        return 4e-7 * slow + only(1, 8e-6 * bump)

    found = diagnose(sweep(seed=4, effect=effect, step=2.0))
    assert found.verdict == "unexplained"
    assert found.effects == ()
    middle = float(found.empirical.split("((t - ")[1].split(" s)")[0])
    assert abs(middle - 1600.0) < 130.0  # half its width


@pytest.mark.slow
@pytest.mark.parametrize(("level", "formula"), [(0.5, "exp(-((f - "), (-0.7, "|f + 0.")])
def test_what_happens_at_one_level_of_the_input_is_not_taken_for_a_catalogued_effect(
    level, formula
):
    """A notch at half of 1 g, and a kink where a converter would change its range."""

    def notch(force, time):
        return only(1, 1.5e-3 * np.exp(-0.5 * ((force[:, 1] - level) / 0.12) ** 2))

    def kink(force, time):
        return only(1, 1.5e-3 * np.abs(force[:, 1] - level))

    found = diagnose(tumble(seed=7, effect=notch if level > 0 else kink))
    assert found.verdict == "unexplained"
    assert found.effects == ()
    assert "accel_y" in found.empirical and formula in found.empirical


@pytest.mark.slow
def test_an_effect_is_as_certain_beside_another_as_alone():
    """Channels of their own have nothing in common, so that the jump of one must not make the other's p smaller."""

    def second_order(force, time):
        return only(1, 3e-4 * force[:, 1] ** 2)

    def jump(force, time):
        # Not so large that the other effect might be what its form leaves behind (`forward.TRACE`).
        return only(0, np.where(time > time.mean(), 2e-3, 0.0))

    def both_at_once(force, time):
        return second_order(force, time) + jump(force, time)

    few = [e for e in CATALOGUE if e.name in ("second_order", "bias_step", "drift")]
    alone = diagnose(tumble(seed=4, effect=second_order), effects=few).effects
    both = diagnose(tumble(seed=4, effect=both_at_once), effects=few).effects
    assert [e.channels for e in both] == [("accel_x",), ("accel_y",)]
    # The variances are fitted again, to a tolerance; under those of the wrong mean it was a tenth.
    assert both[1].evidence.p_value == pytest.approx(alone[0].evidence.p_value, rel=0.1)


@pytest.mark.slow
def test_the_file_has_the_public_fields(second_order):
    _, out = second_order
    written = json.loads((out / "diagnosis.json").read_text())
    assert written["schema"] == "inertiax.diagnosis/1"
    assert written["effects"][0]["name"] == "second_order"
    assert set(written["effects"][0]["evidence"]) >= {"delta_bic", "p_value", "held_out_gain"}
    assert set(written["where"][0]) == {
        "channel",
        "experiment",
        "start",
        "end",
        "driver",
        "excess_rms",
        "p_value",
    }
    assert set(written["fit"]["baseline"]) == {"rms", "chi2_per_dof", "held_out_rms"}
    assert (out / "calibration.json").exists()


# An effect added by a user is found in `test_add_an_effect.py`, by the page that says how.


@pytest.mark.slow
def test_a_plan_of_six_positions_cannot_show_second_or_third_order():
    # With f in {-1, 0, 1}, f² acts on |a| as f³ = f, a bias, and f³ as f⁴ = f², a scale factor.
    report = audit(tumble(step=90.0))
    assert {"second_order", "third_order"} <= set(dict(report.not_testable))


@pytest.mark.slow
def test_a_tumble_in_steps_of_30_degrees_shows_both_but_not_apart_from_their_kin():
    report = audit(tumble(step=30.0))
    assert not {"second_order", "third_order"} & set(dict(report.not_testable))
    aliased = {frozenset((a.first, a.second)) for a in report.aliases}
    assert frozenset(("second_order", "scale_asymmetry")) in aliased
    assert frozenset(("third_order", "odd_quadratic")) in aliased


@pytest.mark.slow
def test_any_differentiable_model_can_be_diagnosed():
    """Scale factors by tanh of temperature, on a rate table at three settings that one log holds behind one another."""
    rng = np.random.default_rng(12)
    plateau = [v * axis for axis in np.eye(3) for v in (-2.0, -1.2, -0.5, 0.5, 1.2, 2.0)]
    rate = np.tile(np.repeat(plateau, 200, axis=0), (3, 1))
    time = np.arange(len(rate)) / 10.0
    probe = np.repeat([-10.0, 25.0, 55.0], 3600) + 0.5 * np.sin(time / 90.0)
    time += np.repeat([0.0, 3600.0, 7200.0], 3600)  # s: the chamber goes on meanwhile

    def predict(parameters, signal):
        temperature = jnp.asarray(signal.temperature)[:, None]
        warm = jnp.tanh((temperature - 25.0) / 30.0)
        scale, bend, bias = (parameters[k][None] for k in ("scale", "bend", "bias"))
        return jnp.asarray(signal.input) * (scale + bend * warm) + bias

    bend = np.tanh((probe[:, None] - 25.0) / 30.0)
    gyro = rate * (1.0 + np.array([3e-3, -2e-3, 4e-3]) * bend) + 0.01
    gyro[:, 2] += 2.5e-4 * rate[:, 2] * np.abs(rate[:, 2])
    gyro += 3e-4 * rng.standard_normal(gyro.shape)
    fits = []
    for c in range(3):
        x = np.stack([rate[:, c], rate[:, c] * bend[:, 0], np.ones(len(rate))], axis=1)
        fits.append(np.linalg.lstsq(x, gyro[:, c], rcond=None)[0])
    parameters = dict(zip(("scale", "bend", "bias"), np.transpose(fits)))

    recording = Recording(time=time, gyro=gyro, temperature=probe)
    with pytest.raises(ValueError, match="plateau of constant rate"):
        diagnose_model(predict, parameters, recording, triad="gyro")
    found = diagnose_model(
        predict, parameters, recording, triad="gyro", inputs=rate, grade="tactical"
    )
    assert [(e.name, e.channels) for e in found.effects] == [("rate_nonlinearity", ("gyro_z",))]
    size = dict(found.effects[0].parameters)["coefficient"]
    assert abs(size.value - 2.5e-4) < 3.0 * size.std


def test_a_stretch_of_more_scatter_is_found_but_neither_noise_nor_one_loud_block():
    rng = np.random.default_rng(11)
    dof = np.full(1200, 8.0)
    quiet = rng.chisquare(8.0, 1200)
    calm = most_scattered(quiet, dof)
    assert calm is not None and calm.p_value > 0.05
    spiked = quiet.copy()
    spiked[700] *= 400.0
    lone = most_scattered(spiked, dof)
    assert lone is not None and lone.p_value > 1e-3
    burst = quiet.copy()
    burst[500:540] *= 1.8  # 40 blocks of 8: sum up by 256, twelve standard deviations of 25
    found = most_scattered(burst, dof)
    assert found is not None and found.p_value < 1e-6
    assert abs(found.first - 500) <= 12 and abs(found.last - 539) <= 12


@pytest.mark.slow
def test_a_short_oscillation_of_one_channel_is_unexplained_and_located():
    def packet(force, time):
        return only(2, 8e-4 * np.sin(2.0 * np.pi * time / 1.3) * (np.abs(time - 400.0) < 30.0))

    found = diagnose(tumble(seed=12, effect=packet))
    assert found.verdict == "unexplained" and found.effects == ()
    assert {w.channel for w in found.where} == {"accel_z"}
    start, end = min(w.start for w in found.where), max(w.end for w in found.where)
    overlap = (min(end, 430.0) - max(start, 370.0)) / (max(end, 430.0) - min(start, 370.0))
    assert overlap > 0.6  # the ends of rests are left out, and a window has a length of 2^k blocks


@pytest.mark.slow
def test_a_stretch_kept_out_is_predicted_better_by_an_effect_that_the_rest_has_named():
    def held(probe, time):
        x = np.empty_like(probe)
        state = probe[0]
        for k, value in enumerate(probe):
            state = min(max(state, value - 6.0), value + 6.0)
            x[k] = state
        return only(1, 2e-6 * (x - probe) / 6.0 * 3.0)

    found, predicted = hold_out(sweep(seed=13, effect=held, step=2.0), start=3700.0)
    assert [e.name for e in found.effects] == ["thermal_hysteresis"]
    assert all(w.end < 3700.0 for w in found.where)
    by_channel = {p.channel: p for p in predicted}
    gain = by_channel["gyro_y"].augmented_rms / by_channel["gyro_y"].baseline_rms
    assert (
        gain < 0.5
    )  # what is left is the white noise of 8-s means, 1e-6 rad/s, against 6e-6 rad/s
    assert by_channel["gyro_x"].effects == ()
    assert by_channel["gyro_x"].augmented_rms == by_channel["gyro_x"].baseline_rms


@pytest.mark.parametrize("turning", [False, True])
def test_effects_of_rates_are_not_told_by_earths(turning):
    rng = np.random.default_rng(0)
    axes = np.concatenate([np.eye(3), -np.eye(3), np.ones((1, 3)), -np.ones((1, 3))])
    up = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    position = np.repeat(np.arange(8), 40)
    rate = 7.3e-5 * up[position]
    if turning:  # each axis at 10 and at 20 °/s
        position, plateaus = np.append(position, np.full(240, -1)), np.repeat(axes[:6], 40, axis=0)
        rate = np.concatenate(
            [rate, np.deg2rad([10.0, 20.0])[np.arange(240) // 20 % 2, None] * plateaus]
        )
    output = rate + 1e-5 * rng.normal(size=rate.shape)
    time = np.arange(len(position)) / 10.0
    recording = Recording(time=time, gyro=output, reference_gyro=rate, position=position)
    (gyros,) = prepare(Campaign((recording,))).triads
    names = {"cross_axis_rate", "rate_nonlinearity", "scale_asymmetry", "saturation"}
    there = names & {t.name for t in gyros.candidates}
    assert there == (names if turning else set())
    assert {gyros.missing[n] for n in names - there} == (
        set() if turning else {"no rates but Earth's"}
    )


@pytest.mark.slow
@pytest.mark.parametrize("width, cools", [(0.0, True), (0.6, True), (0.0, False)])  # °C
def test_a_step_at_a_temperature_is_described_as_that(width, cools):
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 900.0, 0.5)
    x = time / time[-1]
    temperature = -10.0 + 55.0 * (1.0 - np.abs(1.0 - 2.0 * x) if cools else x)
    y = (temperature - 20.0) / 30.0
    gyro = np.stack([2e-3 * y, 1e-3 * y**2, 4e-3 * y - 1e-3 * y**3], axis=1)
    gyro[:, 2] += 5e-3 * (0.5 + 0.5 * np.tanh((temperature - 27.0) / (width or 1e-6)))
    gyro += 2e-4 * rng.normal(size=gyro.shape)
    recording = Recording(
        time=time, gyro=gyro, temperature=temperature[:, None], position=np.zeros(len(time), int)
    )
    model = ModelChoice(gyro_estimator="static", temperature_degree=3)
    found = diagnose(Campaign((recording,), model=model))
    if cools:
        assert found.verdict == "unexplained"
        channel, _, rest = found.empirical.partition(" += (")
        size, at = float(rest.split()[0]), float(rest.partition("step(T - ")[2].split()[0])
        assert channel == "gyro_z" and abs(size / 5e-3 - 1.0) < 0.1
    else:
        (effect,) = found.effects
        assert effect.name == "bias_step" and effect.channels == ("gyro_z",)
        at = float(effect.statement.partition("passed ")[2].split()[0])
    assert abs(at - 27.0) < 0.3
