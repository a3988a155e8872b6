"""The degree over temperature chosen again beside a named effect: a rate table with lever arms and a curved bias."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from diagnose_data import behind
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import pipeline
from inertiax.diagnose.degree_beside import chosen_again
from inertiax.diagnose.findings import find_all
from inertiax.diagnose.problem import prepare
from inertiax.effects import CATALOGUE


G = 9.81
STEP = 0.25  # s
NOISE = 2e-4  # m/s², one sample
TEMPERATURES = (-30.0, -10.0, 10.0, 30.0, 50.0, 70.0)
RATES = (0.5, 1.5, 3.0, 4.5)  # rad/s
ARM = np.array([[0.021, 0.004, -0.003], [0.012, 0.009, 0.002], [0.015, -0.003, 0.006]])  # m
CURVED = np.array([1.5e-3, -1.2e-3, 2e-3])  # m/s², of x², x being the temperature scaled to [-1, 1]
EFFECTS = [e for e in CATALOGUE if e.name in ("size_effect", "temperature_order", "second_order")]


def poses():
    """Each axis up and down, and twelve between."""
    whole = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]
    between = [
        (a * np.eye(3)[k] + b * np.eye(3)[(k + 1) % 3]) / np.sqrt(2.0)
        for k in range(3) for a in (1.0, -1.0) for b in (1.0, -1.0)
    ]  # fmt: skip
    return [*whole, *between]


def table(arms=ARM) -> Campaign:
    """At each temperature rests in two poses of three, and plateaus of both signs about two axes, one of them level."""
    rng = np.random.default_rng(11)
    force, rate, temperature, position, experiment = [], [], [], [], []

    def add(f, w, t, number, k):
        force.extend(f)
        rate.extend(np.broadcast_to(w, (len(f), 3)))
        temperature.extend([t] * len(f))
        position.extend([number] * len(f))
        experiment.extend([k] * len(f))

    for k, t in enumerate(TEMPERATURES):
        for number, pose in enumerate(poses()[:6] + poses()[6::2]):
            add(np.tile(pose, (4, 1)), np.zeros(3), t, -1, k)
            add(np.tile(pose, (8, 1)), np.zeros(3), t, number, k)
        for axis in (0, 2):
            for size in RATES:
                for sign in (1.0, -1.0):
                    w = sign * size * np.eye(3)[axis]
                    angle = np.arange(8)[:, None] * STEP * w
                    up = np.array([0.0, 0.0, 1.0])
                    add(Rotation.from_rotvec(angle).inv().apply(up), w, t, -1, k)
    force, rate, temperature = np.array(force), np.array(rate), np.array(temperature)
    x = (temperature - 20.0) / 50.0
    matrix = np.array([[1e-3, 2e-4, -3e-4], [4e-4, -2e-3, 1e-4], [-2e-4, 3e-4, 3e-3]])
    output = G * force @ (np.eye(3) + matrix).T + np.array([0.02, -0.01, 0.03])
    output += np.outer(x, [0.01, -0.02, 0.015]) + np.outer(x**2, CURVED)
    # ω × (ω × r) of each element at its own place, by NumPy.
    for c in range(3):
        output[:, c] += np.cross(rate, np.cross(rate, arms[c]))[:, c]
    output += NOISE * rng.standard_normal(output.shape)
    recording = Recording(
        np.arange(len(output)) * STEP, accel=output, position=np.array(position),
        experiment=np.array(experiment), temperature=temperature[:, None],
        reference_accel=G * force, reference_gyro=rate,
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference")
    return Campaign((recording,), Site(G), Rig(1e-6), model, "tactical")


@pytest.fixture(scope="module")
def diagnosed():
    """The diagnosis and its calibration, with the problem and the findings that the degree was chosen again from."""
    asked = []

    def recorded(problem, findings):
        asked.append((problem, findings))
        return chosen_again(problem, findings)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "chosen_again", recorded)
        found, calibration = pipeline.diagnose_campaign(table(), effects=EFFECTS)
    ((problem, findings),) = asked
    return found, calibration, problem, findings


@pytest.mark.slow
def test_lever_arms_hide_a_curved_bias_and_the_diagnosis_chooses_the_degree_beside_them(diagnosed):
    found, calibration, problem, _ = diagnosed
    assert problem.plain.model.accel.temperature_degree < 2  # the criterion sees ω × (ω × r)
    assert [e.name for e in found.effects] == ["size_effect"]
    assert found.model.accel.temperature_degree == 2
    assert dict(found.model.chosen_by)["accel.temperature_degree"] == "tool"
    assert "was chosen again beside size_effect: 2 instead of" in found.summary
    assert any("by BIC beside size_effect" in note for note in calibration.notes)
    # The bias at the ends and in the middle: the truth within three standard deviations.
    for t in (-30.0, 20.0, 70.0):
        x = (t - 20.0) / 50.0
        truth = np.array([0.02, -0.01, 0.03]) + x * np.array([0.01, -0.02, 0.015]) + x**2 * CURVED
        phi = np.asarray(calibration.accel.curve.basis(t))
        bias = (phi @ np.asarray(calibration.accel.curve.coefficients))[:3]
        size = len(phi)
        covariance = np.asarray(calibration.accel.covariance).reshape(size, 12, size, 12)
        std = np.sqrt(np.einsum("a,aibi,b->i", phi, covariance, phi))[:3]
        assert np.all(np.abs(bias - truth) < 3.0 * std + 2e-5), t


@pytest.mark.slow
def test_a_degree_that_the_user_chose_is_kept(diagnosed):
    *_, problem, findings = diagnosed
    # All as before but who chose: the tool's degree is raised on these findings, so the user's would be too.
    chosen_by = dict(problem.plain.model.chosen_by) | {"accel.temperature_degree": "user"}
    model = msgspec.structs.replace(problem.plain.model, chosen_by=tuple(sorted(chosen_by.items())))
    assert (
        chosen_again(replace(problem, plain=replace(problem.plain, model=model)), findings) is None
    )


@pytest.mark.slow
def test_without_an_effect_nothing_is_chosen_again():
    problem = prepare(table(arms=np.zeros((3, 3))), EFFECTS)
    assert problem.plain.model.accel.temperature_degree == 2
    findings = find_all(problem.triads, "tactical", lambda _: None)
    assert chosen_again(problem, findings) is None


def ramp(late=127.0) -> Campaign:
    """Rests in all poses, again and again, while a chamber goes up and half down; the elements are late."""
    rng = np.random.default_rng(5)
    order = np.concatenate([rng.permutation(18) for _ in range(5)])
    force = np.repeat(np.array(poses())[order], 13, axis=0)  # 13 s each, three of them in motion
    position = np.where(np.arange(len(force)) % 13 < 3, -1, np.repeat(order, 13))
    time = np.arange(len(force)) * 1.0
    probe = np.interp(time / time[-1], [0.0, 0.55, 1.0], [-15.0, 55.0, -1.0])
    x = (behind(time, probe, late) - 20.0) / 45.0
    output = G * force + np.outer(x, [0.006, -0.015, -0.027]) + np.outer(x**2, [8e-3, -5e-3, -5e-3])
    output += 6e-4 * rng.standard_normal(output.shape)
    recording = Recording(
        time, accel=output, position=position, temperature=probe[:, None], reference_accel=G * force
    )
    model = ModelChoice(accel_estimator="reference")
    return Campaign((recording,), Site(G), Rig(1e-6), model, "tactical")


@pytest.mark.slow
def test_a_lag_that_hides_a_curve_keeps_its_name_when_the_degree_is_chosen_again():
    # With slopes that the lag has bent, a hysteresis and a dependence on the rate of temperature fitted better.
    found = pipeline.diagnose(ramp())
    assert "was chosen again beside thermal_lag" in found.summary
    assert [e.name for e in found.effects] == ["thermal_lag"]
    lag = dict(found.effects[0].parameters)["time_constant"]
    assert abs(lag.value - 127.0) < 3.0 * lag.std < 0.1 * 127.0
