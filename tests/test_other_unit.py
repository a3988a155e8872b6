"""`check` tells that another unit was put in within a campaign, and no change of one unit is called that."""

import numpy as np
import pytest

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


G, ROWS, RATE = 9.81, 60, 25.0
WARM = (-40.0, -10.0, 25.0, 55.0, 85.0)
POSES = 18


def poses(seed):
    """Directions spread over the sphere, in an order by chance."""
    k = np.arange(POSES) + 0.5
    z, angle = 1.0 - 2.0 * k / POSES, np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z**2)
    up = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return np.random.default_rng(seed).permutation(up)


def unit(seed, slopes=1.0):
    """Errors of one unit of a type by temperature: biases of 3 mg, 0.1 % and 1 mrad, and a course of each."""
    rng = np.random.default_rng(seed)
    bias, matrix = rng.normal(0.0, 0.03, 3), rng.normal(0.0, 1e-3, (3, 3))
    slope, curve = rng.normal(0.0, 2e-4, 3), rng.normal(0.0, 2e-6, 3)
    grows = np.diag(rng.normal(0.0, 1.5e-5, 3))

    def read(force, warm, side):
        del side
        x = warm - 20.0
        now = matrix + slopes * x * grows
        return force + force @ now.T + bias + slopes * (slope * x + curve * x**2)

    return read


ONE, OTHER, STEEP = unit(1), unit(2), unit(1, slopes=8.0)


def campaign(read, *, warm=WARM, files=False, seed=7, drift=4.0):
    """Rests of 2.4 s in 18 poses at each setting, in one log or in a file each; `read(force, °C, setting)`."""
    rng = np.random.default_rng(seed)
    made = []
    for k, at in enumerate(warm):
        force = G * poses(seed + k)
        degrees = at + drift * np.linspace(-1.0, 1.0, POSES)
        means = np.stack([read(f, d, k) for f, d in zip(force, degrees, strict=True)])
        rest = np.repeat(means, ROWS + 15, axis=0)
        label = np.arange(POSES).repeat(ROWS + 15)
        label[np.arange(len(label)) % (ROWS + 15) >= ROWS] = -1
        time = (0.0 if files else 1e4 * k) + np.arange(len(label)) / RATE
        noisy = rest + 2e-3 * rng.standard_normal(rest.shape)
        made.append((time, noisy, label, np.repeat(degrees, ROWS + 15), np.full(len(label), k)))
    if not files:
        made = [tuple(np.concatenate(part) for part in zip(*made, strict=True))]
    recordings = tuple(
        Recording(time=t, accel=a, position=p, temperature=w[:, None], experiment=e, name=f"day{n}.csv")
        for n, (t, a, p, w, e) in enumerate(made, 1)
    )  # fmt: skip
    return Campaign(recordings, Site(gravity=G))


def told(read, **settings):
    found = check_campaign(campaign(read, **settings)).findings
    return [f for f in found if f.kind == "other_unit"]


@pytest.mark.parametrize("at", [2, 3])
def test_another_unit_from_one_setting_of_a_chamber_on_is_told(at):
    (found,) = told(lambda f, w, k: (ONE if k < at else OTHER)(f, w, k))
    evidence = dict(found.evidence)
    assert found.severity == "warning" and evidence["settings_before"] == at
    assert evidence["began"] == 1e4 * at and f"{1e4 * at:.6g} s" in found.statement
    assert "another unit" in found.statement and "apart" in found.statement


def test_of_two_files_the_second_is_named():
    alike = (24.0, 27.0)
    sheared = np.array([[1.004, 5e-3, 0.0], [5e-3, 0.997, -4e-3], [0.0, -4e-3, 1.002]])
    far = lambda f, w, k: ONE(f, w, k) if k == 0 else unit(5)(f @ sheared, w, k) + 0.1
    (found,) = told(far, warm=alike, files=True)
    assert found.statement.startswith("day2.csv: ") and "day1.csv" in found.statement
    assert not told(ONE, warm=alike, files=True)


SHOCK = np.array([[1.0, 0.02, 0.0], [-0.02, 1.0, 0.01], [0.0, -0.01, 1.0]])
OF_ONE_UNIT = {
    "nothing": ONE,
    "a steep course": STEEP,
    "hysteresis": lambda f, w, k: STEEP(f * (1.0 + 5e-4 * (k % 2)), w, k) + 8e-3 * (k % 2),
    "a step of one bias": lambda f, w, k: ONE(f, w, k) + [0.1 * (k >= 3), 0.0, 0.0],
    "a restart": lambda f, w, k: ONE(f, w, k) + (k >= 3) * np.array([0.1, -0.05, 0.07]),
    "another supply": lambda f, w, k: (1.0 + 0.01 * (k >= 3)) * (ONE(f, w, k) + 0.02),
    "a new mounting": lambda f, w, k: ONE(f @ (SHOCK if k >= 3 else np.eye(3)), w, k),
    "a bias' bump": lambda f, w, k: STEEP(f, w, k) + 0.1 * np.exp(-(((w - 60.0) / 10.0) ** 2)),
}


@pytest.mark.parametrize("what", OF_ONE_UNIT)
def test_what_one_unit_does_is_not_called_another(what):
    assert not told(OF_ONE_UNIT[what])
    assert not told(OF_ONE_UNIT[what], warm=(25.0, 85.0, -40.0, 25.0, 50.0, -10.0))


@pytest.mark.slow
def test_of_a_hundred_units_by_themselves_none_is_called_two():
    steep = [unit(100 + k, slopes=float(1 + k % 10)) for k in range(100)]
    assert not any(told(read, seed=k, warm=WARM[: 2 + k % 4]) for k, read in enumerate(steep))


@pytest.mark.slow
def test_a_calibration_of_two_units_is_not_to_be_used():
    of = lambda read: judge(calibrate_device(campaign(read)))
    both = of(lambda f, w, k: (ONE if k < 3 else OTHER)(f, w, k))
    assert both.verdict == "doubtful" and "another unit" in both.answer
    assert of(ONE).verdict != "doubtful"
