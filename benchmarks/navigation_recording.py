"""The filter on a public recording with a motion-capture reference: sequence V1_01_easy of the EuRoC MAV data sets.

    python benchmarks/navigation_recording.py --imu mav0/imu0/data.csv \
        --reference mav0/state_groundtruth_estimate0/data.csv

The reference may also be a text file of the trajectory, `t x y z qx qy qz qw`, as many evaluation tools carry it; of
this sequence the public attitudes are known to be off, and those that OpenVINS has computed anew are the ones to take.
The IMU is an ADIS16448 at 200 Hz on a flying quadrotor; the log has no temperature, so that calibration states are
constants. Its calibration is taken as unknown: biases to 5 °/s and 0.2 m/s², scale factors and misalignments to 1 %.

Fixes are the reference's positions once a second, none for 5 s in each 15 s. The heading of the reference's frame is
unknown, so that the Earth's rate is left in the biases. Compared at the ends of the outages: position, tilt and heading
against the reference, for filters with all coefficients, with biases alone, with the calibration that the first one
found in the end and trusts, and with none. Then again with all coefficients and the accelerometers' white noise that
makes the fixes likeliest: on a quadrotor the outputs hold more than the sensor's own, and the fixes tell how much.

Measured: see `docs/benchmarks/navigation-filter.md`.

**Data:** Burri et al., "The EuRoC micro aerial vehicle datasets", Int. J. Robotics Research 35 (2016) 1157-1163.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from scipy.spatial.transform import Rotation

import inertiax as ix
import inertiax.navigation as nav


CLOCK = 1e-4  # s; stamps in text are rounded to 1e-5
RATE, OUTAGE, PERIOD, FIRST = 200, 5, 15, 25  # Hz; s
FIX = 0.01  # m, standard deviation that the filter is told; motion capture is better than that
# Of the recording's own file on the sensor, which widens them for vibration: rad/s/√Hz, rad/s/√s, m/s²/√Hz, m/s²/√s.
GYRO_WHITE, GYRO_WALK, ACCEL_WHITE, ACCEL_WALK = 1.6968e-4, 1.9393e-5, 2.0e-3, 3.0e-3
PRIOR = {"accel.bias": 0.2, "gyro.bias": np.deg2rad(5.0), "accel.matrix": 0.01, "gyro.matrix": 0.01}


def read(imu: Path, reference: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whole seconds of IMU rows (gyro, accelerometer), and places and attitudes of the reference at their ends.

    The first place and attitude are those before the first row. Raises `ValueError` where samples are missing.
    """
    rows = np.loadtxt(imu, delimiter=",", comments="#")
    stamps = rows[:, 0] * 1e-9
    with reference.open(encoding="utf-8") as file:
        commas = "," in file.readline()
    path = np.loadtxt(reference, delimiter="," if commas else None, comments="#")
    if commas:
        time, place, turn = path[:, 0] * 1e-9, path[:, 1:4], path[:, [5, 6, 7, 4]]
    else:
        time, place, turn = path[:, 0], path[:, 1:4], path[:, 4:8]
    nearest = lambda t: np.abs(time - t).argmin()
    same = lambda t: abs(time[nearest(t)] - t) < CLOCK
    first = next(k for k, t in enumerate(stamps) if same(t))
    ends = [k for k in range(first, len(stamps), RATE) if same(stamps[k])]
    whole = np.arange(first, ends[-1] + 1, RATE)
    gaps = np.diff(stamps[first : ends[-1] + 1])
    if len(whole) != len(ends) or np.ptp(gaps) > CLOCK:
        raise ValueError(f"{imu}: samples are missing (steps from {gaps.min()} to {gaps.max()} s).")
    picked = np.array([nearest(stamps[k]) for k in whole])
    attitude = Rotation.from_quat(turn[picked]).as_matrix()
    return rows[first + 1 : ends[-1] + 1, 1:], place[picked], attitude


def calibration() -> ix.Calibration:
    """Nothing known but orders of magnitude; constants over temperature, which is not in the log."""

    def triad(kind: str, places: list[tuple[int, int]]) -> ix.TriadCalibration:
        names = [f"{kind}.bias[{i}]" for i in range(3)]
        names += [f"{kind}.matrix[{i},{j}]" for i, j in places]
        sigma = np.array([PRIOR[n.split("[")[0]] for n in names])
        curve = ix.Curve(ix.Constant(), np.zeros((1, len(names))))
        return ix.TriadCalibration(curve, np.diag(sigma**2), tuple(names), "reference")

    lower = [(i, j) for i in range(3) for j in range(i + 1)]
    return ix.Calibration(
        9.81, triad("accel", lower), triad("gyro", [(i, j) for i in range(3) for j in range(3)])
    )


def make(
    states: str | tuple[str, ...], device: ix.Calibration, white: jax.Array | float = ACCEL_WHITE
) -> nav.Filter:
    """A filter of some of the coefficients, with an accelerometers' noise density."""
    noise = nav.ImuNoise(
        nav.TriadNoise(white=white, walk=ACCEL_WALK),
        nav.TriadNoise(white=GYRO_WHITE, walk=GYRO_WALK),
    )
    frame = nav.LevelFrame(np.deg2rad(47.4), 460.0)  # Zürich
    return nav.Filter(device, states, noise=noise, frame=frame, samples=RATE)


def likeliest_white(run: Callable[[jax.Array], nav.Track]) -> float:
    """The accelerometers' white noise density at which a run's fixes are likeliest, m/s²/√Hz."""
    price = jax.jit(jax.value_and_grad(lambda log: -run(jnp.exp(log)).log_likelihood))
    both = lambda log: tuple(float(x) for x in price(jnp.asarray(log[0])))
    start, bounds = [np.log(ACCEL_WHITE)], [tuple(np.log([0.1, 100.0]) + np.log(ACCEL_WHITE))]
    return float(np.exp(scipy.optimize.minimize(both, start, jac=True, bounds=bounds).x[0]))


def main() -> None:
    """Print the errors at the outages' ends, by filter."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--imu", type=Path, required=True)
    parser.add_argument("--reference", type=Path, required=True)
    given = parser.parse_args()
    rows, place, attitude = read(given.imu, given.reference)
    segments = len(place) - 1
    data = nav.ImuData(rows[:, 3:], rows[:, :3], np.full(len(rows), 25.0), np.asarray(1.0 / RATE))
    after = np.arange(1, segments + 1) - FIRST
    out = (after > 0) & ((after - 1) % PERIOD < OUTAGE)
    last = np.flatnonzero(out & ((after - 1) % PERIOD == OUTAGE - 1))
    fixes = [nav.Position(place[1:], FIX, ~out)]
    print(f"{segments} s, {len(last)} outages of {OUTAGE} s")
    device = calibration()

    def run(filter_: nav.Filter) -> nav.Track:
        start = filter_.start(
            attitude[0], np.zeros(3), place[0],
            attitude_sigma=np.deg2rad(1.0), velocity_sigma=0.05, position_sigma=FIX,
        )  # fmt: skip
        return filter_.run(start, data, fixes)

    def tell(name: str, track: nav.Track) -> None:
        pose = jax.tree.map(np.asarray, track.estimate.navigation)
        error = (place[1:] - pose.position)[last]
        off = np.linalg.norm(error, axis=1)
        turn = Rotation.from_matrix(attitude[1:] @ np.swapaxes(pose.attitude, 1, 2)).as_rotvec()
        spread = np.asarray(track.covariance)[last, 6:, 6:]
        sigma = np.sqrt(np.trace(spread, axis1=1, axis2=2))
        nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(spread), error) / 3.0
        nis = np.asarray(track.corrections[0].nis)[~out] / 3.0
        tilt, heading = np.rad2deg(np.hypot(*turn[last, :2].T)), np.rad2deg(np.abs(turn[last, 2]))
        rms = lambda x: float(np.sqrt(np.mean(x**2)))
        print(
            f"{name:32} position {rms(off):6.3f} m (largest {off.max():.3f}, predicted {rms(sigma):.3f}, NEES/3 "
            f"{nees.mean():.2f}), tilt {rms(tilt):.2f}°, heading {rms(heading):.2f}°, fixes' NIS/3 {nis.mean():.2f}, "
            f"log likelihood {float(track.log_likelihood):.0f}"
        )

    full = run(make("*", device))
    tell("all coefficients", full)
    tell("biases", run(make("*.bias", device)))
    tell(
        "calibration of the run, trusted", run(make((), nav.refined(make("*", device), full.last)))
    )
    tell("none", run(make((), device)))
    white = likeliest_white(lambda density: run(make("*", device, density)))
    tell(f"all, white noise {white:.4f}", run(make("*", device, white)))
    shown = nav.observability(make("*", device), full)
    print(shown.statement())
    for kind in ("accel", "gyro"):
        now = getattr(nav.refined(make("*", device), full.last), kind)
        print(
            kind,
            np.round(now.parameters(25.0)[:3], 4),
            np.round(now.standard_deviations(25.0)[:3], 4),
        )


if __name__ == "__main__":
    with jax.enable_x64(True):
        main()
