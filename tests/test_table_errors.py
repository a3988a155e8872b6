"""A table out of level or out of square: what it does to references, to intervals, and what can be said without it.

The table of `benchmarks/table_coverage.py` turns everything by SciPy's rotations, to all orders.
"""

import dataclasses
import importlib.util
from pathlib import Path

import jax
import numpy as np
import pytest

from inertiax.calibrate.covariance_shares import shares
from inertiax.calibrate.split_covariance import Fit, split
from inertiax.calibrate.table_error_sizes import table_error_sizes, within_statement
from inertiax.data.formats.table_angles import two_axes
from inertiax.data.formats.turntable import Turntable
from inertiax.data.recording import Rig
from inertiax.estimators import ReferenceAccel
from inertiax.fleet.solve.batch import fit_fleet
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.rig_errors import table_words, with_rig_errors
from inertiax.reduction.table_errors import leans_of_part_turns, table_errors


SMALL = 1e-5  # rad


@pytest.fixture(scope="module")
def table():
    path = Path(__file__).parents[1] / "benchmarks" / "table_coverage.py"
    spec = importlib.util.spec_from_file_location("table_coverage", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawn(table):
    rng = np.random.default_rng(5)
    return [table.drawn(rng, stand=True) for _ in range(120)]


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("tilt, skew", [((1, 0), 0), ((0, 1), 0), ((0, 0), 1)])
def test_references_change_as_rotations_to_all_orders_say(table, tilt, skew):
    """In rests and in means at constant rates, of both triads with one sign."""
    stated = Rig(level_uncertainty=SMALL, orthogonality_uncertainty=SMALL, axes=table.AXES)
    found = table_errors(*table.PLAN, stated)
    assert found.known.all()
    _, force, rate = table.readings(SMALL * np.array(tilt), SMALL * skew)
    which = [*tilt, skew].index(1)
    # Second order: 1e-5 of what changes, 9.8 m/s² and 1.7 rad/s times 1e-5, or of the Earth's rate 7e-5 rad/s.
    np.testing.assert_allclose(force - table.PLAN[1], -found.accel[..., which], atol=1e-9)
    atol = 2e-10 if skew else 1e-14
    np.testing.assert_allclose(rate - table.PLAN[2], -found.gyro[..., which], atol=atol)
    assert np.abs(found.accel[..., which]).max() > 9.0 * SMALL


# A rest, the arcs of one axis at a time that lead on from it, deg, and the rest after them.
ARCS = {
    "about the outer axis": ((0, 0), [("outer", 0, 90)]),
    "about the outer axis, the case turned": ((30, 120), [("outer", 45, 110)]),
    "about a level inner axis": ((90, 0), [("inner", 10, 50)]),
    "about an upright inner axis, by the Earth's rate": ((0, 20), [("inner", 20, 70)]),
    "about an inclined inner axis": ((45, 20), [("inner", 20, 260)]),
    "outer, then inner, which the outer has turned over": (
        (90, 315),
        [("outer", 90, 270), ("inner", 315, 0)],
    ),
}


@pytest.mark.parametrize("tilt, skew", [((1, 0), 0), ((0, 1), 0), ((0, 0), 1)])
@pytest.mark.parametrize("arcs", ARCS)
def test_means_over_parts_of_turns_change_as_rotations_to_all_orders_say(table, arcs, tilt, skew):
    """What the mean over whole turns keeps is along the axis alone; a quarter keeps 0.9 of what lies across."""
    start, parts = ARCS[arcs]
    speed = np.deg2rad(60.0)

    def means(tilt, skew):
        at, position, force, rate = dict(zip(("outer", "inner"), start, strict=True)), [], [], []

        def seen(outer, inner, moving):
            turned = table.attitude(np.deg2rad(outer), np.deg2rad(inner), tilt, skew)
            position.append(-1 if moving else len(position))
            force.append(turned.apply(table.UP, inverse=True).reshape(-1, 3).mean(axis=0))
            rate.append(turned.apply(table.EARTH, inverse=True).reshape(-1, 3).mean(axis=0))
            return turned

        seen(at["outer"], at["inner"], False)
        for which, begin, end in parts:
            # Midpoints of 2000 steps: the mean to (step)²/24, 1e-7 of it.
            arc = begin + (end - begin) * (np.arange(2000) + 0.5) / 2000
            angles = {k: np.full(2000, float(v)) for k, v in at.items()} | {which: arc}
            turned = seen(angles["outer"], angles["inner"], True)
            about = table.AXES[1]
            if which == "outer":
                leaning = table.Rotation.from_rotvec([*tilt, 0.0]).apply(table.OUTER)
                about = turned.apply(leaning, inverse=True).mean(axis=0)
            rate[-1] = rate[-1] + np.sign(end - begin) * speed * np.asarray(about)
            at[which] = end
        seen(at["outer"], at["inner"], False)
        return np.array(position), np.array(force), np.array(rate)

    plan = means(np.zeros(2), 0.0)
    stated = Rig(level_uncertainty=SMALL, orthogonality_uncertainty=SMALL, axes=table.AXES)
    found = table_errors(*plan, stated)
    assert found.known.all()
    _, force, rate = means(SMALL * np.array(tilt), SMALL * skew)
    which = [*tilt, skew].index(1)
    # The axis is that of a rate with the Earth's in it: 7e-5 of 1e-4 m/s² and, for rates, of 7e-10 rad/s.
    np.testing.assert_allclose(force - plan[1], -found.accel[..., which], atol=1e-8)
    if not skew:
        np.testing.assert_allclose(rate - plan[2], -found.gyro[..., which], atol=1e-13)


def test_a_part_of_a_turn_about_the_vertical_keeps_the_lean_in_a_direction_of_its_own(table):
    """A lean in a direction drawn at random, its mean over an arc by SciPy's rotations."""
    level, arc, speed = 1e-4, np.deg2rad(130.0), np.deg2rad(60.0)
    rng = np.random.default_rng(4)
    squares = []
    for _ in range(4000):
        lean = np.cross([*(level * rng.standard_normal(2)), 0.0], table.UP)
        angles = rng.uniform(0.0, 2.0 * np.pi) + arc * (np.arange(60) + 0.5) / 60
        turned = table.Rotation.from_rotvec(np.multiply.outer(angles, [0.0, 0.0, 1.0]))
        mean = turned.apply(lean, inverse=True).mean(axis=0)
        squares.append(np.outer(mean, mean))
    told = np.array([-1, 0]), np.tile(table.UP, (2, 1)), np.tile([0.0, 0.0, speed], (2, 1))
    found = leans_of_part_turns(*told, np.full(2, arc / speed), Rig(level_uncertainty=level))
    # 4000 draws tell a variance to sqrt(2 / 4000) = 2.2 %; four sigma.
    size = found[0, 0, 0]
    np.testing.assert_allclose(found[0] / size, np.mean(squares, axis=0) / size, atol=0.09)
    assert not found[1].any()


def by_standings(table, turn):
    """Covariance of forces, of angles of half of a positioning's variance that an axis keeps while it stands, by hand;
    and the part of the variance that each dwell has in it."""
    at = iter([*table.POSITIONS, *(angles for angles, _ in table.PLATEAUS)])
    stairs = iter([stair for stair in table.PLATEAUS for _ in table.RATES])
    of_axis, number, last = ({}, {}), [0, 0], (None, None)
    for k, position in enumerate(table.PLAN[0]):
        if position < 0:
            angles, which = next(stairs)
            last = (None, angles[1]) if which == "outer" else (angles[0], None)
            arcs = [np.full(90, np.deg2rad(a)) for a in angles]
            arcs[which == "inner"] = np.deg2rad(np.arange(90) * 4.0)
            case = table.attitude(*arcs, np.zeros(2), 0.0)
            off = [case.apply(np.cross(e, table.UP), inverse=True).mean(axis=0) for e in np.eye(3)]
            own = number[0] if which == "inner" else ("stair", angles)
            of_axis[0].setdefault(own, []).append((k, None, -np.transpose(off)))
            continue
        angles = next(at)
        number = [n + (a != b) for n, a, b in zip(number, angles, last, strict=True)]
        last, rows = angles, turn[3 * k : 3 * k + 3]
        to_case = table.attitude(*np.deg2rad(angles), np.zeros(2), 0.0).as_matrix().T
        of_axis[0].setdefault(number[0], []).append((k, number[1], rows @ to_case))
        of_axis[1].setdefault(number[1], []).append((k, number[0], rows))
    whole, part = np.zeros((len(turn), len(turn))), np.zeros(len(table.PLAN[0]))
    for standings in of_axis:
        for dwells in standings.values():
            others = {other for _, other, _ in dwells}
            if len(others) < 2 and None not in others:
                continue
            moved = np.zeros((len(turn), 3))
            for k, other, rows in dwells:
                moved[3 * k : 3 * k + 3] = rows
                part[k] += 0.5 * (other is not None)
            whole += 0.5 * table.POSITION**2 * moved @ moved.T
    return whole, part


@pytest.mark.slow
def test_the_fit_is_generalised_least_squares_with_the_table_s_covariance(table, drawn):
    """A dense covariance of positions, noise and table by hand; one device, the same in a fleet, and its budget."""
    dwells = with_rig_errors(drawn[0][0], table.STATED)
    force, count = np.asarray(dwells.reference_accel), dwells.num_dwells
    design = np.concatenate(
        [np.tile(np.eye(3), (count, 1, 1)), np.einsum("ij,nk->nijk", np.eye(3), force).reshape(count, 3, 9)], axis=2
    ).reshape(3 * count, 12)  # fmt: skip
    skew = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.concatenate([skew(v) for v in force])
    number = dwells.positioning
    same = (number[:, None] == number[None, :]) & (number >= 0)[:, None] | np.eye(count, dtype=bool)
    standing, part = by_standings(table, turn)
    assert {0.0, 0.5} == set(part)
    alone = np.sqrt(np.outer(1.0 - part, 1.0 - part))
    whole = standing + table.POSITION**2 * np.kron(same * alone, np.ones((3, 3))) * (turn @ turn.T)
    common = table_errors(*table.PLAN, table.STATED).accel.reshape(-1, 3)
    whole += common @ common.T + table.FORCE_NOISE**2 * np.eye(3 * count)
    inverse = np.linalg.inv(whole)
    covariance = np.linalg.inv(design.T @ inverse @ design)
    answer = covariance @ design.T @ inverse @ (dwells.accel - force).reshape(-1)
    sigma = np.sqrt(np.diagonal(covariance))
    estimator = ReferenceAccel()
    alone = joint_fit_one(estimator, Constant(), dwells)
    own = np.asarray(alone.covariance)
    many = fit_fleet(estimator, Constant(), jax.tree.map(lambda x: np.stack([x, x]), dwells))
    # Of the parameters by their sigmas; normal matrices have a condition of 1e5.
    assert np.abs((np.asarray(alone.curve.coefficients)[0] - answer) / sigma).max() < 1e-6
    np.testing.assert_allclose(
        own / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-6
    )
    # A fleet finds what scatter is left: none, or little beside 120 rows.
    assert np.abs((many.parameters[0] - answer) / sigma).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diagonal(many.covariance[0])) / sigma, 1.0, atol=0.05)
    parts = split(Fit(estimator, alone.curve, own, dwells, 3 * count), table.STATED)
    by_source = {p.source: p.covariance for p in parts}
    np.testing.assert_allclose(np.diagonal(sum(by_source.values())), np.diagonal(own), rtol=1e-9)
    positions = whole - common @ common.T - table.FORCE_NOISE**2 * np.eye(3 * count)
    to_answer = covariance @ design.T @ inverse
    np.testing.assert_allclose(
        np.diagonal(by_source["rig position"]),
        np.diagonal(to_answer @ positions @ to_answer.T),
        rtol=1e-5,
    )
    moved = to_answer @ common
    np.testing.assert_allclose(
        np.diagonal(by_source["rig level"]),
        np.sum(moved[:, :2] ** 2, axis=1),
        rtol=1e-5,
        atol=1e-20,
    )
    np.testing.assert_allclose(
        np.diagonal(by_source["rig orthogonality"]), moved[:, 2] ** 2, rtol=1e-5, atol=1e-20
    )


def test_the_budget_has_the_lean_of_parts_of_turns_under_the_rig_s_level(table, drawn):
    """Of a quarter of a turn about the vertical 0.9 of the lean stay, across it, which are no noise of the dwell."""
    stated = dataclasses.replace(table.STATED, axes=None)  # else the Earth's rate tells it
    rate = np.asarray(drawn[0][0].reference_gyro)
    speed = np.linalg.norm(rate, axis=1)
    dwells = dataclasses.replace(
        drawn[0][0],
        duration=np.pi / 2.0 / speed,
        rows=np.zeros((len(rate), 4), int),  # of a recording, so that its durations are known
    )
    wider = with_rig_errors(dwells, stated)
    found = shares(ReferenceAccel(), wider, stated, 3)
    upright = np.asarray(dwells.position < 0) & (
        np.abs(np.sum(rate * dwells.reference_accel, axis=1)) > 0.99 * speed * 9.81
    )
    assert upright.any()
    own = (table.LEVEL * 9.81 * np.sin(np.pi / 4.0) / (np.pi / 4.0)) ** 2
    part = own / (
        own + table.FORCE_NOISE**2
    )  # plateaus of one axis share their positioning, which is not in here
    eigen = np.linalg.eigvalsh(found["rig level"][upright])
    np.testing.assert_allclose(eigen, np.tile([0.0, part, part], (len(eigen), 1)), atol=1e-6)
    eigen = np.linalg.eigvalsh(found["dwell noise"][upright])
    np.testing.assert_allclose(eigen[:, :2], 1.0 - part, atol=1e-6)


@pytest.mark.slow
def test_intervals_of_misalignments_cover_with_the_statement_and_not_without(table, drawn):
    """1440 values, of which the twelve of a device go together in part: 95 ± 4 % is five sigma of 120 devices."""
    inside = lambda rig: np.abs([table.deviations(d, rig) for d in drawn]) < 1.96
    stated, unstated = inside(table.STATED), inside(table.UNSTATED)
    for triad in range(2):
        assert 0.91 < stated[:, triad].mean() < 0.99
    assert unstated[:, 0].mean() < 0.8
    assert unstated[:, 1].mean() < stated[:, 1].mean() - 0.04


def test_a_table_within_its_statement_is_no_missing_physics_and_one_beyond_it_is(table):
    """The sizes that the fit predicts are those of the table; three sigma are allowed, ten are not."""
    truth = {"within": np.array([2.0, -1.5]), "beyond": np.array([10.0, 0.0])}
    for name, tilt in truth.items():
        _, force, rate = table.readings(table.LEVEL * tilt, 0.0)
        dwells = dataclasses.replace(with_rig_errors(table.drawn(np.random.default_rng(3))[0], table.STATED),
                                     accel=force, gyro=rate)  # fmt: skip
        fit = joint_fit_one(ReferenceAccel(), Constant(), dwells)
        sizes = table_error_sizes(ReferenceAccel(), fit.curve, dwells)
        # 32 positions of 4″ in each of two directions tell a level to 4″ / sqrt(32) = 0.07 of 10″.
        np.testing.assert_allclose(-sizes[:2], tilt, atol=0.15)
        kept = within_statement(sizes)
        assert np.any(kept[:2]) == (name == "within")


def test_what_cannot_be_used_is_said(table, drawn):
    dwells = drawn[0][0]
    both = ("reference", "reference")
    assert table_words(dwells, table.STATED, both) == ()
    assert table_words(dwells, Rig(), both) == ()
    assert table_words(dwells, dataclasses.replace(table.STATED), ("invariant", "gravity")) == ()
    (axes,) = table_words(dwells, Rig(orthogonality_uncertainty=1e-5), both)
    assert "orthogonality_uncertainty is in no ±" in axes and "[table] axes" in axes
    # Without the Earth's rate the references tell no heading.
    still = dataclasses.replace(
        dwells, reference_gyro=np.where(dwells.position[:, None] < 0, dwells.reference_gyro, 0)
    )
    (heading,) = table_words(still, Rig(level_uncertainty=1e-5), both)
    assert "level_uncertainty is in no ±" in heading and "latitude" in heading
    assert with_rig_errors(still, Rig(level_uncertainty=1e-5)).table_accel is None
    # Without the axes a plateau about a level axis has an azimuth that nobody knows: its level is its own.
    (plateaus,) = table_words(dwells, Rig(level_uncertainty=1e-5), both)
    assert "drawn anew at 12 plateaus" in plateaus
    own = (
        with_rig_errors(dwells, Rig(level_uncertainty=1e-5)).accel_covariance
        - dwells.accel_covariance
    )
    along = np.trace(own, axis1=1, axis2=2)
    level = [k for k in range(len(along)) if along[k] > 0.0]
    assert len(level) == 12
    np.testing.assert_allclose(along[level], (1e-5 * 9.81) ** 2, rtol=1e-6)


def test_axes_are_those_of_the_room_and_of_the_case():
    # Azimuth 90°: what is called north points east, so that "east" is south.
    turned = Turntable(axes=("east", "up"), case=("north", "up", "east"), azimuth=90.0)
    outer, inner = two_axes(turned)
    np.testing.assert_allclose(outer, [-1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(inner, [0.0, 1.0, 0.0], atol=1e-15)
    assert two_axes(Turntable(axes=("up",))) is None
