"""What cannot be right in a campaign, by evidence that these tests compute on their own."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate, DeviceFailure
from inertiax.cli import main
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign, Finding
from inertiax.plausibility.gravity import normal_gravity
from inertiax.plausibility.samples import _stretch_hashes
from inertiax.plausibility.turns import misfits, Motions, PERMUTATIONS
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.missed_turns import missed
from inertiax.reduction.rests import find_rests
from inertiax.reduction.rotations_between_rests import with_motions


G = 9.81
RATE = 100.0
REST, MOVE, RESTS = 250, 100, 14


def hand(seed: int = 0) -> dict[str, np.ndarray]:
    """Rests with turns by SciPy's rotations between them; the errors of a consumer device."""
    rng = np.random.default_rng(seed)
    attitude, up, omega = Rotation.random(random_state=seed), [], []
    fraction = np.arange(1, MOVE + 1) / MOVE
    done = fraction - np.sin(2 * np.pi * fraction) / (2 * np.pi)
    speed = (1 - np.cos(2 * np.pi * fraction)) * RATE / MOVE
    for _ in range(RESTS):
        up.append(np.tile(attitude.inv().apply([0, 0, 1.0]), (REST, 1)))
        omega.append(np.zeros((REST, 3)))
        axis = rng.standard_normal(3)
        turn = rng.uniform(0.8, 2.0) * axis / np.linalg.norm(axis)
        path = attitude * Rotation.from_rotvec(done[:, None] * turn)
        up.append(path.inv().apply([0, 0, 1.0]))
        omega.append(speed[:, None] * turn)
        attitude = attitude * Rotation.from_rotvec(turn)
    up, omega = np.concatenate(up), np.concatenate(omega)
    n = len(up)
    return {
        "time": np.arange(n) / RATE,
        "accel": 1.01 * G * up + [0.1, -0.15, 0.2] + 0.02 * rng.standard_normal((n, 3)),
        "gyro": 0.99 * omega + [0.01, -0.008, 0.005] + 0.002 * rng.standard_normal((n, 3)),
        "temperature": 25.0 + 0.01 * rng.standard_normal((n, 1)),
    }


def findings(columns: dict[str, np.ndarray], site: Site | None = None) -> list[Finding]:
    recording = Recording(**columns, name="a.csv")
    seen = check_campaign(Campaign((recording,), site or Site(gravity=G)))
    return [f for f in seen.findings if f.severity != "note"]


@pytest.mark.parametrize(("jump", "found"), [(3e-3, True), (0.0, False)])
def test_a_zero_that_jumps_less_than_by_g_sensitivity_is_told(jump, found):
    columns = hand(3)
    columns["gyro"] += columns["accel"] @ np.array([[2, 0, 1], [0, -2, 0], [1, 0, 2]]) * 1e-4
    columns["gyro"][(REST + MOVE) * 7 :, 1] += jump
    told = [f for f in findings(columns) if f.kind == "restart"]
    assert [f.what for f in told] == ["gyro_y"] * found
    assert all(
        dict(f.evidence)["jump"] == pytest.approx(jump, abs=5e-4) for f in told
    )  # 3 sigma of two rests


@pytest.mark.parametrize("seed", range(3))
def test_slow_turns_in_rests_by_hand_are_no_jump(seed):
    """All lie in one pose but for two, where a hand turns on by degrees a second: no zero and no g-sensitivity."""
    rng = np.random.default_rng(seed)
    force, rate, position = [], [], []
    for k in range(20):
        by_hand = k in (3, 16)
        up = np.array([3.0, 4.0, -8.5]) if by_hand else [8.8, 1.2 * (k > 8), 4.0]
        decay = np.exp(-np.arange(150) / 40.0)
        turn = np.outer(decay, np.radians([9.0, 3.0, -6.0 if k == 3 else 8.0])) * by_hand
        force.append(np.array(up) + 0.05 * rng.normal(size=(150, 3)))
        rate.append(np.radians([-1.2, -0.8, 0.3]) + turn + 0.005 * rng.normal(size=(150, 3)))
        position += 150 * [k]
    columns = {"accel": np.concatenate(force), "gyro": np.concatenate(rate)}
    columns |= {"time": np.arange(3000) / 50.0, "position": np.array(position)}
    assert not [f for f in findings(columns) if f.kind == "restart"]


def only(columns: dict[str, np.ndarray], kind: str, severity: str = "error") -> Finding:
    found = [f for f in findings(columns) if f.kind == kind]
    assert found and found[0].severity == severity, findings(columns)
    return found[0]


@pytest.mark.parametrize(("degrees", "seed"), [(0.0, 5), (8.0, 5), (8.0, 8)])
def test_accelerometers_turned_against_the_gyros_halfway_are_found(degrees, seed):
    """Among errors of 1.5° that a zero of 0.2 m/s² makes; and a constant misalignment of 3° is none."""
    columns = hand(seed=seed)
    half = np.arange(len(columns["time"])) >= 7 * (REST + MOVE) if degrees else slice(None)
    turn = Rotation.from_rotvec([0.0, np.radians(degrees or 3.0), 0.0])
    columns["accel"] = columns["accel"].copy()
    columns["accel"][half] = turn.apply(columns["accel"][half])
    found = [f for f in findings(columns) if f.kind == "remounted"]
    assert len(found) == (degrees > 0.0)
    for f in found:
        evidence = dict(f.evidence)
        assert evidence["angle"] == pytest.approx(np.radians(8.0), abs=np.radians(1.5))
        assert "mostly about y" in f.statement and abs(evidence["motions_before"] - 6) <= 1


def test_a_good_log_has_no_finding():
    assert findings(hand()) == []


def test_the_ratio_of_the_gyros_unit_is_that_of_scipys_rotations():
    columns = hand()
    # Independently: how much the rates have to shrink for SciPy to turn gravity as the accelerometers saw it.
    rates = np.degrees(columns["gyro"])
    zero = rates[:REST].mean(axis=0)
    first, last = REST - 1, REST + MOVE
    before, after = (
        columns["accel"][a:b].mean(axis=0) for a, b in ((0, REST), (last, last + REST))
    )
    turned = []
    factors = np.geomspace(0.014, 0.022, 60)
    for factor in factors:
        direction = before / np.linalg.norm(before)
        for w in rates[first:last] - zero:
            direction = Rotation.from_rotvec(-factor * w / RATE).apply(direction)
        turned.append(np.linalg.norm(direction - after / np.linalg.norm(after)))
    expected = 1.0 / factors[int(np.argmin(turned))]
    found = only({**columns, "gyro": rates}, "gyro_unit")
    ratio = dict(found.evidence)["ratio"]
    assert ratio == pytest.approx(expected, rel=0.05)  # one motion against thirteen
    assert ratio == pytest.approx(180 / np.pi, rel=0.03)
    assert found.remedy == '[columns]\ngyro = { unit = "deg/s" }'


def test_integrated_rates_of_all_exchanges_are_those_of_scipy():
    rng = np.random.default_rng(4)
    angle = 0.1 * rng.standard_normal((2, 30, 3))
    before, after = rng.standard_normal((2, 2, 3))
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    got = misfits(Motions(angle, before, after))
    for k in (0, 5, 13, 30, 47):
        for m in range(2):
            u = before[m]
            for step in angle[m] @ PERMUTATIONS[k].T:
                u = Rotation.from_rotvec(-step).apply(u)
            assert got[k, m] == pytest.approx(np.arccos(u @ after[m]), abs=1e-9)


AXES = {
    "gyro x and y": ("gyro", [[0, 1, 0], [1, 0, 0], [0, 0, 1]], "gyro x and y are exchanged"),
    "gyro x mirrored": ("gyro", np.diag([-1, 1, 1]), "gyro x is mirrored"),
    "accel z mirrored": ("accel", np.diag([1, 1, -1]), "accel z is mirrored"),
    "accel y and z": ("accel", [[1, 0, 0], [0, 0, 1], [0, 1, 0]], "accel y and z are exchanged"),
    "gyro all": ("gyro", -np.eye(3), "gyro x and y and z are mirrored"),
}


@pytest.mark.parametrize("name", AXES)
def test_exchanged_and_mirrored_axes_are_named_with_what_mends_them(name, tmp_path):
    triad, matrix, words = AXES[name]
    columns = hand()
    right = columns[triad].copy()
    columns[triad] = columns[triad] @ np.array(matrix, float).T
    found = only(columns, "axes")
    assert words in found.statement
    # The remedy, as it stands in campaign.toml, gives the axes back.
    assert found.remedy is not None
    names = [f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz"]
    rows = np.column_stack([columns["time"], columns["accel"], columns["gyro"]])
    np.savetxt(
        tmp_path / "a.csv", rows, delimiter=",", header=",".join(["time", *names]), comments=""
    )
    toml = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["a.csv"]\n'
    (tmp_path / "campaign.toml").write_text(toml + found.remedy)
    mended = load_campaign(tmp_path)
    assert check_campaign(mended).verdict == "plausible"
    np.testing.assert_allclose(getattr(mended.recordings[0], triad), right, atol=1e-9)


def test_milliseconds_read_as_seconds_are_an_error_of_the_clock():
    columns = hand()
    found = only({**columns, "time": 1e3 * columns["time"]}, "time_unit")
    assert found.remedy == '[columns]\ntime = { unit = "ms" }'
    assert dict(found.evidence)["step"] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1 / 9.80665, '"g"'), (1e3 / 9.80665, '"mg"'), (16384 / 9.80665, "16384")]
)
def test_the_accelerometers_unit(factor, unit):
    columns = hand()
    found = only({**columns, "accel": factor * columns["accel"]}, "accel_unit")
    assert found.remedy is not None and unit in found.remedy


def test_normal_gravity_is_that_of_the_geodetic_tables():
    # GRS 80 (Moritz 1980): 9.7803267715 at the equator, 9.8321863685 at the poles, 9.806199203 at 45 degrees.
    assert normal_gravity(0.0) == pytest.approx(9.7803267715, abs=1e-9)
    assert normal_gravity(np.pi / 2) == pytest.approx(9.8321863685, abs=1e-8)
    assert normal_gravity(np.pi / 4) == pytest.approx(9.8061992, abs=1e-6)
    (found,) = findings(hand(), Site(gravity=G, latitude=0.0))
    assert found.kind == "gravity" and found.severity == "warning"


def test_zeros_on_the_way_of_coarse_gyros_are_codes_like_others():
    """Zeros between the two sides of zero are a measurement; zeros many codes from the rows around them are none."""
    columns = hand()
    gyro = 5e-3 * np.round((columns["gyro"] + np.array([0.015, -0.01, 0.005])) / 5e-3)
    for row, side in ((1000, 1.0), (1400, -1.0)):
        gyro[row - 1 : row + 2] = (
            side * 0.01 * np.array([[1.0, -2.0, 1.0], [0, 0, 0], [-2.0, 1.0, -1.0]])
        )
    own = np.flatnonzero(np.all(gyro == 0.0, axis=1))
    assert len(own) < 20  # few enough not to be a habit at rest
    assert "dropout" not in str(findings({**columns, "gyro": gyro}))
    dropped = gyro.copy()
    moving = np.flatnonzero(np.abs(gyro).max(axis=1) > 0.3)
    dropped[moving[[10, 60]]] = 0.0
    (found,) = [f for f in findings({**columns, "gyro": dropped}) if f.kind == "dropout"]
    assert dict(found.evidence)["rows"] == 2


def gaps(columns: dict[str, np.ndarray]) -> list[Finding]:
    campaign = Campaign((Recording(**columns),), Site(G))
    return [f for f in check_campaign(campaign).findings if f.kind == "gap"]


def test_stamps_that_scatter_lose_no_rows():
    """A row's stamp late by up to 0.8 of a step makes steps of 0.2 to 1.8; every tenth row gone makes steps of 2."""
    columns = hand()
    rng = np.random.default_rng(2)
    step = float(np.median(np.diff(columns["time"])))
    late = columns["time"] + rng.uniform(0.0, 0.8 * step, len(columns["time"]))
    assert gaps({**columns, "time": late}) == []
    kept = rng.random(len(columns["time"])) > 0.1
    shaken = columns["time"] + rng.uniform(0.0, 0.05 * step, len(columns["time"]))
    (found,) = gaps({k: v[kept] for k, v in {**columns, "time": shaken}.items()})
    assert dict(found.evidence)["share"] == pytest.approx(0.111, abs=0.02)


def test_kinds_of_broken_samples():
    rng = np.random.default_rng(1)
    columns = hand()
    n = len(columns["time"])
    dropped = columns["accel"].copy()
    dropped[rng.integers(0, n, 12)] = 0.0
    assert only({**columns, "accel": dropped}, "dropout", "warning")
    held = {k: columns[k][np.arange(n) // 2 * 2] for k in ("accel", "gyro")}
    assert dict(only({**columns, **held}, "repeated_samples", "warning").evidence)[
        "share"
    ] == pytest.approx(0.5, abs=0.01)
    assert only({**columns, "gyro": np.zeros((n, 3))}, "constant_channel")
    clipped = np.clip(columns["accel"], -8.0, 8.0)
    assert only({**columns, "accel": clipped}, "saturation", "warning")
    codes = np.round(columns["accel"] / 6e-4).astype(int) + 2**15
    stuck = ((codes | 16) - 2**15) * 6e-4
    found = only({**columns, "accel": stuck}, "stuck_bit", "warning")
    assert dict(found.evidence)["size"] == pytest.approx(16 * 6e-4, rel=1e-3)
    copied = columns["gyro"].copy(), columns["accel"].copy()
    for x in copied:
        x[2000:2200] = x[300:500]
    found = only({**columns, "gyro": copied[0], "accel": copied[1]}, "repeated_samples", "warning")
    assert "from 3 s and again from 20 s" in found.statement
    held = np.where(np.abs(columns["gyro"]) < 0.03, 0.0, columns["gyro"])  # rad/s; zeros are below
    found = only({**columns, "gyro": held}, "held_at_rest", "warning")
    assert "gyro_x, gyro_y, gyro_z read exactly zero" in found.statement
    assert "dropout" not in str(findings({**columns, "gyro": held}))
    unit = G * columns["accel"] / np.linalg.norm(columns["accel"], axis=1, keepdims=True)
    assert only({**columns, "accel": unit}, "normalised", "warning")
    coarse = 0.2 * np.round(columns["accel"] / 0.2)
    coarse[:250] = [9.8, 0.2, 0.0]  # x never reads more
    coarse[:, 0] = np.minimum(coarse[:, 0], 9.8)
    assert "saturation" not in str(findings({**columns, "accel": coarse}))
    fast = {**columns, "time": 1.25 * columns["time"]}
    assert dict(only(fast, "gyro_unit", "warning").evidence)["ratio"] == pytest.approx(
        1.25 * 0.99, rel=0.02
    )
    shocks = np.clip(columns["accel"], -90.0, 150.0)
    shocks[[800, 1500, 2300], 0], shocks[[801, 1501, 2301], 0] = -90.0, 150.0
    assert "wrap" not in str(findings({**columns, "accel": shocks}))


def test_bursts_in_opposite_poses_are_no_counts_that_wrap_round():
    """Eleven samples in each pose, as a script takes them that waits for a key: x goes from +1 g to −1 g at once."""
    rng = np.random.default_rng(8)
    up = np.repeat(np.tile([[1.0, 0, 0], [-1.0, 0, 0], [0, 0.6, 0.8]], (12, 1)), 11, axis=0)
    accel = G * up + 0.02 * rng.standard_normal(up.shape)
    assert "wrap" not in str(findings({"time": np.arange(len(accel)) / 50.0, "accel": accel}))
    # Signed readings written as unsigned do wrap: one of the two is no reading of a pose.
    counts = np.where(accel < 0.0, accel + 8 * G, accel)
    assert "wrap" in str(findings({"time": np.arange(len(accel)) / 50.0, "accel": counts}))


def test_one_motion_with_lost_rows_is_named_and_left_out():
    """Its error would be spread over all gyro parameters; SciPy's rotations made the others."""
    columns, motion = hand(), 3
    first = motion * (REST + MOVE) + REST
    kept = np.r_[0 : first + 20, first + 80 : len(columns["time"])]
    lost = {k: v[kept] for k, v in columns.items()} | {"time": np.arange(len(kept)) / RATE}
    found = only(lost, "motions", "warning")
    assert dict(found.evidence)["motions"] == 1
    assert dict(found.evidence)["began"] == (pytest.approx(first / RATE, abs=0.6),)
    recording = Recording(**lost, name="a.csv")
    turns = with_motions((recording,), reduce_to_dwells((recording,)))
    assert turns.num_motions == RESTS - 2
    assert "1 that miss gravity's turn" in turns.statement
    assert not missed(
        np.full(8, 0.5), np.full(8, 1.0)
    ).any()  # all of them: no single motion's fault
    assert not missed(np.array([*[0.02] * 8, 0.37]), np.full(9, 3.1)).any()  # a scale factor's


def test_rows_that_a_logger_filled_in_are_no_rest():
    """Seven seconds of placeholders before the first sample: they were the quietest rest, and the only one."""
    columns, rows = hand(), 700
    filled = {
        "time": np.arange(rows + len(columns["time"])) / RATE,
        "accel": np.concatenate([np.tile([0.0, 0.0, G], (rows, 1)), columns["accel"]]),
        "gyro": np.concatenate([np.zeros((rows, 3)), columns["gyro"]]),
    }
    found, live = (find_rests(Recording(**c), window=1.0) for c in (filled, columns))
    assert len(live.start) == RESTS
    np.testing.assert_allclose(found.start, live.start + rows, atol=50)  # half a window
    np.testing.assert_allclose(found.stop, live.stop + rows, atol=50)


@pytest.mark.parametrize("taps", [0, 9])
def test_a_device_that_warms_up_in_one_pose_is_not_disturbed_by_that(taps):
    """Ten minutes; a bias falls by 17 of a sample's noise: its first samples cross a level about the median singly."""
    rng = np.random.default_rng(8)
    time = np.arange(60_000) / RATE
    course = np.exp(-time / 80.0)[:, None] * [0.0, 0.34, 0.0]
    accel = [0.0, 0.0, G] + course + 0.02 * rng.standard_normal((len(time), 3))
    gyro = 0.002 * rng.standard_normal((len(time), 3))
    for at in rng.integers(1000, 59_000, taps):
        accel[at : at + 30] += 3.0 * rng.standard_normal((30, 3))
        gyro[at : at + 30] += 0.5
    columns = {"time": time, "accel": accel, "gyro": gyro}
    told = [f for f in findings(columns) if f.kind == "disturbed_rest"]
    assert len(told) == (1 if taps else 0)


def faces(up: np.ndarray) -> list[Recording]:
    rng = np.random.default_rng(2)
    names = [f"{s}{a}.csv" for s in ("pos", "neg") for a in "XYZ"]
    return [
        Recording(
            time=np.arange(300) / RATE,
            accel=G * u + 0.02 * rng.standard_normal((300, 3)),
            name=name,
        )
        for u, name in zip(up, names, strict=True)
    ]


def test_a_face_that_stands_twice_is_named_with_its_files():
    up = np.concatenate([np.eye(3), -np.eye(3)])
    good = Campaign(tuple(faces(up)), Site(gravity=G))
    assert check_campaign(good).verdict == "plausible"
    up[2] = up[5]
    (found,) = check_campaign(Campaign(tuple(faces(up)), Site(gravity=G))).of("error")
    assert found.kind == "positions"
    assert "posZ.csv" in found.statement and "negZ.csv" in found.statement


def table() -> dict[str, np.ndarray]:
    """Ten labelled positions with the reference of each, and slews between them."""
    rng = np.random.default_rng(3)
    up = rng.standard_normal((10, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    path = np.concatenate(
        [
            np.concatenate([np.tile(a, (200, 1)), np.linspace(a, b, 50)])
            for a, b in zip(up, np.roll(up, -1, 0))
        ]
    )
    label = np.concatenate([np.r_[np.full(200, k), np.full(50, -1)] for k in range(10)])
    return {
        "time": np.arange(len(path)) / RATE,
        "accel": G * path + 0.005 * rng.standard_normal(path.shape),
        "position": label,
        "reference_accel": G * path,
    }


def test_references_that_contradict_the_outputs():
    good = table()
    assert findings(good) == []
    wrong = good["reference_accel"].copy()
    wrong[good["position"] == 4] *= -1.0
    assert "position 4" in only({**good, "reference_accel": wrong}, "reference").statement
    wrong = good["reference_accel"].copy()
    a, b = good["position"] == 2, good["position"] == 7
    wrong[a], wrong[b] = good["reference_accel"][b], good["reference_accel"][a]
    assert "exchanged" in only({**good, "reference_accel": wrong}, "positions").statement
    turned = good["reference_accel"] @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    assert "x and y are exchanged" in only({**good, "reference_accel": turned}, "axes").statement
    other = only({**good, "reference_accel": 1.003 * good["reference_accel"]}, "gravity", "warning")
    assert dict(other.evidence)["ppm"] == pytest.approx(3000, rel=0.01)
    early = np.append(good["position"][30:], np.full(30, -1))
    found = only({**good, "position": early}, "positions", "warning")
    assert dict(found.evidence)["seconds"] == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("mirrored", ["y", "xz", "xyz"])
def test_gyros_that_a_table_turns_about_one_axis_at_a_time_are_mirrored(mirrored):
    """Each axis has a third of the plateaus, so that a median over all is blind to the one that is wrong."""
    rng = np.random.default_rng(5)
    plateaus = [s * rate * axis for axis in np.eye(3) for rate in (0.5, 1.0) for s in (1.0, -1.0)]
    rate = np.concatenate(
        [np.concatenate([np.zeros((200, 3)), np.tile(w, (300, 1))]) for w in plateaus]
    )
    columns = {
        "time": np.arange(len(rate)) / RATE,
        "gyro": rate + 0.01 + 0.002 * rng.standard_normal(rate.shape),
        "reference_gyro": rate,
    }
    assert findings(columns) == []
    signs = np.array([-1.0 if a in mirrored else 1.0 for a in "xyz"])
    found = only({**columns, "gyro": signs * columns["gyro"]}, "axes")
    names = " and ".join(mirrored)
    assert f"when gyro {names} {'is' if len(mirrored) == 1 else 'are'} mirrored" in found.statement
    assert dict(found.evidence)["misfit"] < 0.05


@pytest.mark.slow
def test_calibrate_refuses_an_error_and_goes_on_by_force():
    columns = hand()
    columns["gyro"] = np.degrees(columns["gyro"])
    campaign = Campaign((Recording(**columns),), Site(gravity=G))
    (refused,) = calibrate(campaign)
    assert isinstance(refused, DeviceFailure)
    assert 'unit = "deg/s"' in refused.reason
    (forced,) = calibrate(campaign, force=True)
    assert not isinstance(forced, DeviceFailure)
    assert [f.kind for f in forced.plausibility if f.severity == "error"] == ["gyro_unit"]
    assert any("57" in w for w in forced.warnings)
    quality = judge(forced)
    assert quality.verdict == "doubtful" and "57" in quality.answer


def test_the_command_prints_the_document(tmp_path: Path, capsys):
    columns = hand()
    names = [f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz"]
    rows = np.column_stack([columns["time"], columns["accel"], np.degrees(columns["gyro"])])
    np.savetxt(
        tmp_path / "a.csv", rows, delimiter=",", header=",".join(["time", *names]), comments=""
    )
    toml = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["a.csv"]\n'
    (tmp_path / "campaign.toml").write_text(toml)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(tmp_path), "--json"])
    assert not ended.value.code
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "inertiax.check/1" and document["verdict"] == "implausible"
    (found,) = document["findings"]
    assert set(found) == {"kind", "severity", "what", "statement", "evidence", "remedy"}
    assert found["kind"] == "gyro_unit" and found["evidence"]["pairs"] >= RESTS - 3
    assert tomllib.loads(toml + found["remedy"])["columns"] == {"gyro": {"unit": "deg/s"}}


def test_a_stretchs_number_is_its_polynomial_in_64_bits():
    rows, length = np.random.default_rng(0).standard_normal((60, 6)), 20
    found = _stretch_hashes([rows[:, :3], rows[:, 3:]], length)
    single = _stretch_hashes([rows[:, :3], rows[:, 3:]], 10)
    assert len(found) == 41 and len(single) == 51 and len(set(found.tolist())) == 41
    # Twice 10 rows are 20: f(0..19) = f(0..9) + f(10..19) times the factor to the tenth, in Python's whole numbers.
    factor = pow(0x100000001B3, 10, 2**64)
    for k in range(41):
        assert int(found[k]) == (int(single[k]) + factor * int(single[k + 10])) % 2**64
    again = _stretch_hashes([np.tile(rows[:, :3], (2, 1)), np.tile(rows[:, 3:], (2, 1))], length)
    assert again[0] == again[60] and found[0] == again[0]
