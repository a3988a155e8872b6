"""A thermal lag that one package has: one time constant for three channels; data from plain NumPy."""

import jax
import numpy as np
import pytest

from diagnose_data import behind, poses, SLOPE, sweep, TAU
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare, retuned
from inertiax.diagnose.selection.constraints import twice
from inertiax.diagnose.selection.evidence import bank, count_forms, judge
from inertiax.effects import CATALOGUE


G = 9.81
LAG = [e for e in CATALOGUE if e.name == "thermal_lag"]


def ramps(seed=0, *, late_probe=False):
    """Tumbles while the chamber goes up, down and up; the magnitude of the specific force is all that is known.

    The elements are late by `TAU`, or with `late_probe` the probe is.
    """
    rng = np.random.default_rng(seed)
    force = np.repeat(
        np.concatenate([poses()] * 6), 12, axis=0
    )  # 12 s each, the first two in motion
    position = np.where(
        np.arange(len(force)) % 12 < 2, -1, np.arange(len(force)) // 12 % len(poses())
    )
    time = np.arange(len(force)) * 1.0
    turn = np.array([0.0, 0.3, 0.4, 0.7, 0.8, 1.0]) * time[-1]
    probe = np.interp(time, turn, [-10.0, 50.0, 50.0, -10.0, -10.0, 40.0])
    matrix = np.array([[1e-3, 0, 0], [2e-3, -2e-3, 0], [-1e-3, 1e-3, 3e-3]])
    element = behind(time, probe, TAU)
    if late_probe:
        probe, element = element, probe
    output = G * force @ (np.eye(3) + matrix).T + (element[:, None] - 20.0) * SLOPE
    output = output + 1e-3 * rng.standard_normal(output.shape)
    recording = Recording(
        time=time, accel=output, temperature=probe[:, None], position=position,
    )  # fmt: skip
    model = ModelChoice(accel_estimator="invariant", temperature_degree=2)
    return Campaign((recording,), Site(G), Rig(1e-5), model, "tactical")


@pytest.mark.slow
def test_a_lag_of_all_channels_is_one_candidate_and_shows_where_no_single_one_does():
    with jax.enable_x64(True):
        (prepared,) = prepare(ramps(), LAG).triads
        listed = [t for t in prepared.candidates if t.name == "thermal_lag"]
        joint = [t for t in listed if t.joint]
        assert joint and len(listed) == 4 * len(joint)
        for term in joint[:2]:
            alone = [t for t in listed if not t.joint and t.variant.label == term.variant.label]
            # |f| feels the weighted sum of what the channels feel.
            total = sum(t.columns[0] for t in alone)
            assert np.allclose(term.columns[0], total, rtol=1e-9, atol=1e-15)
        (same,) = retuned(prepared, joint[0], [joint[0].setting])
        assert same.channels == (0, 1, 2)
        assert np.allclose(same.columns[0], joint[0].columns[0], rtol=1e-9, atol=1e-15)
        system = prepared.system
        null = fit_noise(system)
        ranked = judge(system, bank(system, [null], []), listed, [], count_forms(listed), None)
        best = ranked[0]
        single = max(c.ratio for c in ranked if not c.term.joint)
    assert best.term.joint and best.ratio > single + 10.0
    assert twice([best], next(c for c in ranked if not c.term.joint))


@pytest.mark.slow
def test_rows_of_three_channels_hold_the_joint_lag_in_each():
    with jax.enable_x64(True):
        (prepared,) = prepare(sweep(1), LAG).triads
    joint = next(t for t in prepared.candidates if t.joint)
    label = joint.variant.label
    for c in range(3):
        (alone,) = (
            t for t in prepared.candidates if t.channels == (c,) and t.variant.label == label
        )
        assert np.allclose(joint.columns[c], alone.columns[0], rtol=1e-12, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thermal_lag", "probe_lag"])
def test_the_lag_of_a_package_is_named_with_one_time_constant(name):
    found = diagnose(ramps(seed=1, late_probe=name == "probe_lag"))
    assert [e.name for e in found.effects] == [name]
    (effect,) = found.effects
    assert effect.channels == ("accel_x", "accel_y", "accel_z")
    values = dict(effect.parameters)
    assert set(values) == {"time_constant", "amplitude"}
    tau, amplitude = values["time_constant"], values["amplitude"]
    assert tau.std is not None and amplitude.std is not None
    assert tau.value == pytest.approx(TAU, abs=4.0 * tau.std) and tau.std < 0.3 * TAU
    assert amplitude.value == pytest.approx(1.0, abs=4.0 * amplitude.std)
