"""Raw IMU messages of NovAtel's receivers, in ASCII.

The examples of the messages and the scale factors are those of the OEM7 manual (pages RAWIMUS and RAWIMUSX), and of the
ROS driver `novatel_oem7_driver`.
"""

import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.novatel import as_rows, is_novatel


G = 9.80665
SHORT = (
    b"%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c"
    b"28"
)
EXTENDED = (
    b"%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,196192,417138,-1000837"
    b"*038422a7"
)
# With the long header, whose fields are those of any of these receivers' messages
LONG = (
    b"#RAWIMUA,COM1,0,68.5,FINESTEERING,2209,491526.257,02040020,3fd1,16248;2209,491526.256977,ea5afe00,329334720,"
    b"-3204310,4514326,188462,413016,-1005634*1ff8b2dd"
)
POSITION = b"#BESTPOSA,COM1,0,78.5,FINESTEERING,1419,336148.000,02000040,6145,2724;SOL_COMPUTED,SINGLE*6f19e0ba"


def test_the_manuals_examples_are_read():
    text = b"\n".join([b"<OK", SHORT, POSITION, EXTENDED, LONG, LONG[:120]]) + b"\n"
    assert is_novatel(text) and not is_novatel(POSITION) and not is_novatel(b"time,ax\n1,2\n")
    names, *rows = as_rows(text).decode().splitlines()
    assert names.startswith("gps_time") and len(rows) == 3
    # 2209 weeks and 491 612 s from 6 January 1980, 315 964 800 s of 1970; x, y, z from z, −y, x.
    assert rows[0] == "1652459612.253588,4410363,2512321,329303960,-1009773,-607017,309705"
    assert rows[1].split(",")[1:4] == ["4508389", "2706935", "329308016"]
    assert rows[2].split(",")[4:] == ["-1005634", "-413016", "188462"]


def turned_by_hand(rate, force_count, rate_count, path):
    """A log of 20 rests of 3 s, with turns of a second between them, in counts gained per sample."""
    rng = np.random.default_rng(8)
    attitude, force, turning = Rotation.identity(), [], []
    rows = int(rate)
    for _ in range(20):
        force.append(np.tile(attitude.inv().apply([0.0, 0.0, G]), (3 * rows, 1)))
        turning.append(np.zeros((3 * rows, 3)))
        axis = rng.standard_normal(3)
        turn = axis / np.linalg.norm(axis) * rng.uniform(0.7, 1.5)
        steps = (1.0 - np.cos(2.0 * np.pi * (np.arange(rows) + 0.5) / rows))[:, None] * turn / rows
        turned = attitude * Rotation.from_rotvec(np.cumsum(steps, axis=0))
        attitude = turned[-1]
        force.append(turned.inv().apply([0.0, 0.0, G]))
        turning.append(steps * rate)
    accel = np.concatenate(force) * 1.002 + [0.02, -0.01, 0.03]
    gyro = np.concatenate(turning) + [1e-3, -2e-3, 5e-4]
    accel += 2e-3 * rng.standard_normal(accel.shape)
    gyro += 2e-4 * rng.standard_normal(gyro.shape)
    x, y, z = np.rint(accel.T / rate / force_count).astype(int)
    p, q, r = np.rint(gyro.T / rate / rate_count).astype(int)
    with path.open("w") as file:
        for k, (ax, ay, az, gx, gy, gz) in enumerate(zip(x, y, z, p, q, r, strict=True)):
            at = f"{100.0 + k / rate:.9f}"
            file.write(
                f"%RAWIMUSA,2387,{at[:7]};2387,{at},00000077,{az},{-ay},{ax},{gz},{-gy},{gx}*0\n"
            )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "rate", "force", "turn"),
    [
        ("STIM300", 125.0, 2.0**-22, np.deg2rad(2.0**-21)),
        ("HG1900", 100.0, 2.0**-27 / 3.2808, 2.0**-33),
        ("ADIS16488", 200.0, 200.0 / 2.0**31, np.deg2rad(720.0 / 2.0**31)),
    ],
)
def test_gravity_tells_the_imu_and_its_counts(tmp_path, kind, rate, force, turn):
    """Drafted, and calibrated to the errors that were put in."""
    turned_by_hand(rate, force, turn, tmp_path / "log.ASC")
    draft = draft_campaign(tmp_path / "log.ASC", tmp_path)
    (tmp_path / "campaign.toml").write_text(draft.text)
    columns = tomllib.loads(draft.text)["columns"]
    assert kind in draft.told["accel"] and "gyro" in draft.told
    # Of four digits
    assert columns["accel"]["scale"] * force * rate == pytest.approx(1.0, rel=1e-3)
    assert columns["gyro"]["scale"] * turn * rate == pytest.approx(1.0, rel=1e-3)
    found = calibrate_device(load_campaign(tmp_path)).calibration
    for triad, bias, scale in (
        (found.accel, [0.02, -0.01, 0.03], 2e-3), (found.gyro, [1e-3, -2e-3, 5e-4], 0.0),
    ):  # fmt: skip
        (values,), (sigmas,) = triad.over(np.zeros(1))
        named = dict(zip(triad.names, zip(values, sigmas, strict=True), strict=True))
        for k, b in enumerate(bias):
            value, sigma = named[f"{triad.names[0].split('.')[0]}.bias[{k}]"]
            assert abs(value - b) < 4.0 * sigma + 1e-3 * abs(b)
            value, sigma = named[f"{triad.names[0].split('.')[0]}.matrix[{k},{k}]"]
            assert abs(abs(value - 1.0 if value > 0.5 else value) - scale) < 4.0 * sigma + 2e-3


def test_where_two_imus_have_the_same_counts_it_is_said(tmp_path):
    """FSAS and KVH 1750 gain the same velocity per count, and other angles."""
    lines = "".join(
        f"%RAWIMUSA,2387,1;2387,{k / 100:.2f},00000077,{k % 3},{k % 5},64270,{k % 2},{k % 7},{k % 4}*0\n"
        for k in range(3000)
    )
    (tmp_path / "rest.ASC").write_text(lines)
    draft = draft_campaign(tmp_path / "rest.ASC", tmp_path)
    assert "FSAS" in draft.untold["gyro"] and "KVH 1750 has 92160" in draft.untold["gyro"]


def test_the_manuals_example_reads_gravity_by_epsons_counts(tmp_path):
    """IMU type 41 of the extended form is Epson's G320: 0.2 mg per 2¹⁶ counts."""
    fields = [int(n) for n in SHORT.split(b"*")[0].split(b",")[-6:]]
    lines = "".join(
        f"%RAWIMUSA,2209,1;2209,{k / 125:.3f},ea5afe00,"
        + ",".join(str(n + 900 * ((k * m) % 7)) for n, m in zip(fields, range(1, 7), strict=True))
        + "*0\n"
        for k in range(3000)
    )
    (tmp_path / "rest.txt").write_text(lines)
    draft = draft_campaign(tmp_path / "rest.txt", tmp_path)
    assert "Epson G320" in draft.told["accel"]
    (tmp_path / "campaign.toml").write_text(draft.text)
    (recording,) = load_campaign(tmp_path).recordings
    assert np.linalg.norm(recording.accel.mean(axis=0)) == pytest.approx(G, rel=0.01)
    assert np.degrees(np.abs(recording.gyro).max()) < 0.2
