"""The population of a line against simulated truth, and calibration with it as a prior."""

import msgspec
import numpy as np
import polars as pl
import pytest
from scipy.stats import chi2

from fleet_data import device_table, GRAVITY, HIGH, LOW, parameters
from inertiax.estimators import ReferenceAccel
from inertiax.fleet import (
    between_devices,
    fleet_calibration,
    Population,
    read_population,
    run_fleet,
    stack_dwells,
    TriadPopulation,
    write_population,
)
from inertiax.fleet.population.empirical_bayes import fit_informed
from inertiax.fleet.population.population import lower_triangle, symmetric
from inertiax.fleet.population.unit_covariance import deviation
from inertiax.fleet.solve.triad_model import TriadModel
from inertiax.physics.temperature import Constant
from inertiax.reduction.dwells import Dwells


# All of it waits for the same Monte Carlo.
pytestmark = pytest.mark.slow


def _line(rng: np.random.Generator, devices: int, unknowns: int, noise: float):
    """True mean and covariance between devices, the devices, their estimates with covariances."""
    factor = np.tril(rng.normal(0, 0.3, (unknowns, unknowns))) + np.eye(unknowns)
    units = 10.0 ** rng.uniform(-4, -2, unknowns)  # m/s² beside per unit
    sigma = factor @ factor.T * np.outer(units, units)
    mean = 3.0 * units * rng.standard_normal(unknowns)
    truth = mean + rng.standard_normal((devices, unknowns)) @ (units[:, None] * factor).T
    mixing = rng.normal(0, 0.4, (devices, unknowns, unknowns)) + np.eye(unknowns)
    mixing *= noise * units[:, None] * 10.0 ** rng.uniform(-0.5, 0.5, (devices, 1, 1))
    estimates = truth + np.einsum("dij,dj->di", mixing, rng.standard_normal(truth.shape))
    return mean, sigma, truth, estimates, np.einsum("dij,dkj->dik", mixing, mixing)


def _standardised(found, mean, sigma, covariances):
    """Errors of Σ and μ in units of their sampling error: one device tells Σ_ij with the variance
    T_ii T_jj + T_ij², and μ_i with T_ii, T = Σ + C_d."""
    total = sigma + covariances
    size = np.diagonal(total, axis1=1, axis2=2)
    of_one = size[:, :, None] * size[:, None, :] + total**2
    error = (found.covariance - sigma) * np.sqrt((1.0 / of_one).sum(axis=0))
    return error, (found.mean - mean) * np.sqrt((1.0 / size).sum(axis=0))


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_mean_and_covariance_are_recovered_within_sampling_error(noise):
    rng = np.random.default_rng(3)
    mean, sigma, _, estimates, covariances = _line(rng, 1500, 9, noise)
    found = between_devices(estimates, covariances)
    assert found.converged
    of_sigma, of_mean = _standardised(found, mean, sigma, covariances)
    # Largest of 45 normal errors: 4 is passed once in 350 fleets.
    assert np.abs(of_sigma).max() < 4.0
    assert np.abs(of_mean).max() < 4.0
    # Σ is free of the estimates' own noise: taken in, the variances would be 10 σ (at noise 1) too large.
    assert np.diagonal(of_sigma).mean() < 2.0


def test_the_restricted_estimate_has_no_bias():
    """Few devices: the usual covariance divides by n − 1; here with own noise, against many repetitions."""
    ratios = []
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        truth = rng.standard_normal((8, 1))
        found = between_devices(truth + 0.5 * rng.standard_normal((8, 1)), np.full((8, 1, 1), 0.25))
        ratios.append(float(found.covariance[0, 0]))
    # A χ² of 7 degrees times 1.25/7, less 0.25: mean 1 ± 0.67 / √1000; clipping at 0 adds < 0.01.
    # Without the restriction it would be 7/8 · 1.25 − 0.25 = 0.84.
    assert abs(np.mean(ratios) - 1.0) < 4 * 0.67 / np.sqrt(1000)


def test_fewer_devices_than_unknowns_still_give_a_usable_prior():
    """The prior of 20 devices with 27 unknowns: new devices of the line lie as far from it as it says."""
    squares, plain = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        _, _, _, estimates, covariances = _line(rng, 220, 27, 0.2)
        found = between_devices(estimates[:20], covariances[:20])
        new = deviation(
            estimates[20:], covariances[20:], found.mean, found.covariance, found.mean_covariance
        )
        squares.append(np.square(new.distance).mean() / 27)
        plain.append(np.linalg.matrix_rank(np.cov(estimates[:20].T)))
    assert max(plain) == 19  # without shrinkage there is no prior at all
    # 1 would be a known Σ. Sampling error of 20 devices makes new ones look farther: (n−1)/(n−2) = 1.06 for
    # each variance alone, and what shrinkage leaves of spurious correlations.
    assert 0.9 < np.mean(squares) < 2.0


def test_devices_far_out_are_named_and_do_not_enter():
    rng = np.random.default_rng(11)
    mean, sigma, _, estimates, covariances = _line(rng, 300, 18, 0.2)
    clean = between_devices(estimates, covariances)
    spoiled = estimates.copy()
    spread = np.sqrt(np.diagonal(sigma))
    spoiled[7, 4] += 12 * spread[4]
    spoiled[120] += 4 * spread * np.where(np.arange(18) % 2, 1.0, -1.0)
    spoiled[250] *= -30.0
    found = between_devices(spoiled, covariances)
    assert set(np.flatnonzero(~found.kept)) == {7, 120, 250} | set(np.flatnonzero(~clean.kept))
    assert len(np.flatnonzero(~clean.kept)) <= 1  # a clean fleet has one with a chance of 1 %
    _, of_mean = _standardised(found, mean, sigma, covariances)
    assert np.abs(of_mean).max() < 4.0
    away = deviation(spoiled, covariances, found.mean, found.covariance, found.mean_covariance)
    assert np.abs(away.sigmas[7]).argmax() == 4


def test_a_batch_of_other_biases_is_far_out_as_a_group():
    """Three biases 4, 3.2 and 4 standard deviations off: chi-square 42 of three, but two or three sigmas of 24."""
    rng = np.random.default_rng(4)
    estimates = rng.standard_normal((56, 24))
    estimates[29, :3] = 4.0, 3.2, 4.0
    covariances = np.tile(0.01 * np.eye(24), (56, 1, 1))
    biases = np.arange(3)
    alone = between_devices(estimates, covariances)
    found = between_devices(estimates, covariances, groups=(biases, np.arange(3, 24)))
    assert alone.kept.all() and np.flatnonzero(~found.kept).tolist() == [29]


def test_small_fleets_raise_no_false_alarm():
    """Ten devices tell Σ badly, and are judged accordingly."""
    alarms = 0
    for seed in range(100):
        _, _, _, estimates, covariances = _line(np.random.default_rng(1000 + seed), 10, 9, 0.2)
        groups = (np.arange(3), np.arange(3, 9))
        alarms += not between_devices(estimates, covariances, groups=groups).kept.all()
    # 1 % of the fleets by construction; six or more of 100 by chance in 5 of 10 000 cases.
    assert alarms < 6


def test_distances_of_the_line_are_chi_squared():
    rng = np.random.default_rng(12)
    mean, sigma, _, estimates, covariances = _line(rng, 1000, 9, 0.5)
    away = deviation(estimates, covariances, mean, sigma, np.zeros((9, 9)))
    for level in (0.5, 0.95):
        inside = np.mean(np.square(away.distance) < chi2.ppf(level, 9))
        assert abs(inside - level) < 4 * np.sqrt(level * (1 - level) / 1000)


def test_too_few_devices_are_refused():
    with pytest.raises(ValueError, match="4 devices; the spread between devices needs 5"):
        between_devices(np.zeros((4, 2)), np.tile(np.eye(2), (4, 1, 1)))


def _population(unknowns: int = 2) -> Population:
    names = tuple(f"accel.bias[{k}]" for k in range(unknowns))
    model = TriadModel("invariant", names, 0, 20.0, 30.0)
    one = TriadPopulation(
        model, (0.0,) * unknowns, lower_triangle(np.eye(unknowns)), lower_triangle(np.eye(unknowns)), 0.0, 9, 0.0
    )  # fmt: skip
    return Population(accel=one)


def test_population_file_is_read_back_and_strict(tmp_path):
    file = tmp_path / "population.json"
    write_population(_population(), file)
    assert read_population(file) == _population() == read_population(tmp_path)
    text = file.read_text()
    for old, new, message in (
        ("inertiax.population/1", "inertiax.population/9", "schema is 'inertiax.population/9'"),
        ('"scatter"', '"scatters"', "unknown key 'scatters'"),
        ('"mean": [', '"mean": [1.0,', "'mean' must hold 2 finite numbers; it has 3"),
        ('"schema"', "schema", "not valid JSON"),
    ):
        file.write_text(text.replace(old, new, 1))
        with pytest.raises(ValueError, match=message) as caught:
            read_population(file)
        assert str(file) in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="no population.json in this folder"):
        read_population(tmp_path.parent)


def test_a_covariance_that_is_none_is_refused():
    one = _population().accel
    with pytest.raises(ValueError, match="not positive definite"):
        msgspec.structs.replace(one, covariance=(-9.0, 0.0, 1.0))


def test_lower_triangles_are_symmetric_matrices():
    np.testing.assert_array_equal(symmetric([1.0, 2.0, 3.0]), [[1.0, 2.0], [2.0, 3.0]])


# --- runs ----------------------------------------------------------------------------------------


def _write(folder, truth, *, experiments=4, positions=range(18), runs=None, model=True, seed=5):
    """Devices of a line; `runs` keeps only those experiments."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    tables = [device_table(rng, name, t, experiments) for name, t in truth.items()]
    table = pl.concat(tables).filter(pl.col("position").is_in(list(positions)))
    if runs is not None:
        table = table.filter(pl.col("experiment").is_in(list(runs)))
    table.write_parquet(folder / "line.parquet", row_group_size=5000)
    said = '[model]\naccel_estimator = "invariant"\ntemperature_degree = 1\n' if model else ""
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.parquet"]\n{said}'
    )


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A line of 60 devices with full programmes, calibrated; and 40 further ones, true values only."""
    folder = tmp_path_factory.mktemp("population")
    rng = np.random.default_rng(77)
    offset = parameters(rng, 1)  # the line's mean
    truth = {f"D{k:03d}": offset + parameters(rng, 1) for k in range(100)}
    old = dict(list(truth.items())[:60])
    _write(folder / "full", old)
    run_fleet(folder / "full", folder / "results")
    return folder, dict(list(truth.items())[60:])


def _errors(folder, truth):
    """Errors of the coefficients in the fitted basis, and their covariances."""
    errors, covariances = [], []
    for name, c in truth.items():
        found = fleet_calibration(folder, name).accel
        low, high = found.curve.basis.low, found.curve.basis.high
        at = lambda t, c=c: c[0] + c[1] * (2 * t - LOW - HIGH) / (HIGH - LOW)
        expected = np.stack([(at(low) + at(high)) / 2, (at(high) - at(low)) / 2])
        errors.append((np.asarray(found.curve.coefficients) - expected).ravel())
        covariances.append(np.asarray(found.covariance))
    return np.array(errors), np.array(covariances)


def test_a_run_ends_with_its_population(known):
    folder, _ = known
    found = read_population(folder / "results").accel
    assert found.devices + len(found.outliers) == 60
    # Between-device sigmas of `fleet_data.parameters`: 3e-3 (bias: times g), and 0.3 of that for the slope;
    # each is known to 1/√120 from 60 devices, and the largest of 18 such errors is within 4 of them.
    spread = found.spread(np.array([(LOW + HIGH) / 2]))[0]
    expected = np.r_[np.full(3, 3e-3 * GRAVITY), np.full(6, 3e-3)]
    assert np.abs(spread / expected - 1.0).max() < 4 / np.sqrt(120)


@pytest.fixture(scope="module")
def short(known):
    """Six positions at one temperature, 18 unknowns, of 40 new devices of the line and one that is none."""
    folder, truth = known
    # 20 sigmas of the line, and no scale factor is off by the 10 % that would say it without the line.
    odd = truth["D060"] + np.r_[[np.full(9, 20 * 3e-3)], [np.zeros(9)]]
    _write(folder / "short", truth | {"ODD": odd}, positions=range(6), runs=[1], model=False)
    prior = read_population(folder / "results")
    assert run_fleet(folder / "short", folder / "out", prior=prior).calibrated == 40
    return folder, truth


def test_short_programmes_get_an_honest_calibration(short):
    """The errors of the 40 devices are what the posterior says."""
    folder, truth = short
    errors, covariances = _errors(folder / "out", truth)
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    inside = np.mean(np.abs(errors) < 1.96 * sigma)
    # 720 coefficients of 40 devices, of one prior whose own sigmas are known to 9 %: 95 % ± 3 %.
    assert abs(inside - 0.95) < 0.03
    square = np.einsum("di,dij,dj->d", errors, np.linalg.inv(covariances), errors)
    # Mean of 40 χ² of 18 degrees: 18 ± 0.95, and up to a third more for a prior from 60 devices.
    assert 14.2 < square.mean() < 26.0
    prior = read_population(folder / "results").accel
    alone = np.sqrt(np.diagonal(prior.prior_covariance))
    # The six faces tell the biases and scale factors at that temperature: far better than the line's spread.
    assert np.median(sigma[:, :3] / alone[:3]) < 0.35


def test_a_run_with_a_prior_goes_on_with_that_prior_only(short):
    folder, _ = short
    with pytest.raises(ValueError, match="holds a run with a prior"):
        run_fleet(folder / "short", folder / "out")
    prior = read_population(folder / "results")
    again = run_fleet(folder / "short", folder / "out", prior=prior)
    assert (again.tasks_before, again.calibrated) == (1, 40)
    other = msgspec.structs.replace(prior, accel=msgspec.structs.replace(prior.accel, scatter=1.0))
    with pytest.raises(ValueError, match="holds a run with another prior"):
        run_fleet(folder / "short", folder / "out", prior=other)
    # What was drawn to the prior does not tell the line anew.
    assert read_population(folder / "out").accel.covariance == prior.accel.covariance


def test_a_device_unlike_the_line_is_set_aside_where_only_the_line_could_tell(short):
    folder, _ = short
    aside = dict(pl.read_parquet(folder / "out" / "quarantine.parquet").iter_rows())
    assert set(aside) == {"ODD"}
    assert (
        "unlike the prior's devices" in aside["ODD"] and "record a full programme" in aside["ODD"]
    )


def test_without_a_prior_the_same_devices_tell_biases_and_scale_factors_alone(known, tmp_path):
    _, truth = known
    some = dict(list(truth.items())[:6])
    _write(tmp_path / "short", some, positions=range(6))
    summary = run_fleet(tmp_path / "short", tmp_path / "out")
    assert summary.calibrated == 6
    diagonal = tuple(f"accel.matrix[{i},{i}]" for i in range(3))
    assert summary.model.accel.parameters == (*(f"accel.bias[{i}]" for i in range(3)), *diagonal)


def test_a_prior_of_another_model_is_refused(known, tmp_path):
    folder, truth = known
    _write(tmp_path / "short", dict(list(truth.items())[:3]))
    text = (tmp_path / "short" / "campaign.toml").read_text()
    (tmp_path / "short" / "campaign.toml").write_text(text.replace("degree = 1", "degree = 0"))
    with pytest.raises(
        ValueError, match="temperature_degree = 0, but the prior's devices were .* 1"
    ):
        run_fleet(tmp_path / "short", tmp_path / "out", prior=read_population(folder / "results"))


def test_a_linear_problem_with_a_prior_is_bayesian_regression():
    """Against (Σ⁻¹ + Hᵀ R⁻¹ H)⁻¹ and its mean in NumPy: four positions for twelve unknowns."""
    rng = np.random.default_rng(9)
    names = ReferenceAccel().names
    factor = rng.normal(0, 1, (12, 12)) + 2 * np.eye(12)
    sigma = 1e-6 * factor @ factor.T
    mean = rng.normal(0, 1e-3, 12)
    model = TriadModel("reference", names, 0, 0.0, 1.0)
    prior = TriadPopulation(
        model, tuple(mean), lower_triangle(0.9 * sigma), lower_triangle(0.1 * sigma), 3e-4, 50, 0.0
    )
    sigma = sigma * 49 / 47  # Student's t of 49 degrees
    devices, expected = [], []
    for _ in range(3):
        force = GRAVITY * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
        truth = mean + np.linalg.cholesky(sigma) @ rng.standard_normal(12)
        design = np.concatenate(
            [np.tile(np.eye(3), (4, 1, 1)), np.kron(np.eye(3), force[:, None])], 2
        )
        noise = (4e-4**2 + 3e-4**2) * np.eye(12)  # a dwell's own noise and the line's scatter
        design = design.reshape(12, 12)
        output = (
            force.ravel() + design @ truth + np.linalg.cholesky(noise) @ rng.standard_normal(12)
        )
        covariance = np.linalg.inv(np.linalg.inv(sigma) + design.T @ np.linalg.solve(noise, design))
        away = design.T @ np.linalg.solve(noise, output - force.ravel() - design @ mean)
        expected.append((mean + covariance @ away, covariance))
        devices.append(_rests(output.reshape(4, 3), force))
    found = fit_informed(ReferenceAccel(), Constant(), stack_dwells(devices), prior).fit
    for k, (value, covariance) in enumerate(expected):
        size = np.sqrt(np.diagonal(covariance))
        assert found.converged[k]
        # The solve ends within 1e-7 standard deviations; normal equations of condition 1e4 lose 1e-8.
        np.testing.assert_allclose((found.parameters[k] - value) / size, 0.0, atol=1e-5)
        np.testing.assert_allclose(found.covariance[k], covariance, atol=1e-6 * size.max() ** 2)


def _rests(output: np.ndarray, force: np.ndarray) -> Dwells:
    count = len(output)
    return Dwells(
        time=10.0 * np.arange(count),
        duration=np.full(count, 8.0),
        count=np.full(count, 100.0),
        temperature=np.zeros(count),
        experiment=np.zeros(count, int),
        position=np.arange(count),
        valid=np.ones(count, bool),
        accel=output,
        accel_covariance=np.tile(4e-4**2 * np.eye(3), (count, 1, 1)),
        reference_accel=force,
    )
