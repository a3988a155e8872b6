"""Every reader of a file, as a function of bytes: what the fuzzers call, and small valid files to start from.

A reader returns, or raises a plain `ValueError` (or `OSError`) of one line, which the command line prints as it
stands. Everything else is a finding.
"""

import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import h5py
import msgspec
import numpy as np
import polars as pl
import scipy.io

from exports_cases import calibration, NOISE
from inertiax.calibration.calibration import read_calibration, write_calibration
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap, csv, Layout, read_recordings
from inertiax.data.formats.columns import TimeColumn
from inertiax.data.formats.temperature_log import read_temperature_log
from inertiax.exports import export
from inertiax.exports.noise import settings_from_noise
from inertiax.exports.recording_source import mapping_of
from inertiax.exports.registry import by_name, read_calibration_of
from inertiax.physics.temperature import CubicSpline, Polynomial
from inertiax.simulate import load_scenario
from inertiax.simulate.truth import read_truth
from readers_cases import made_up
from test_readers_arrays import matlab_73
from test_readers_flight import dataflash, raw_log
from test_readers_ros import bag
from test_readers_sessions import EUROC


LONGEST_MESSAGE = 1500  # characters: names of a hostile file's columns are repeated in it


class Target(NamedTuple):
    """A reader, the file that the bytes become, files beside it, and where to start."""

    file: str
    read: Callable[[Path], object]
    seeds: Callable[[], list[bytes]]
    beside: Callable[[], dict[str, bytes]] = dict


def attempt(target: Target, folder: Path, content: bytes) -> str | None:
    """The message with which a reader refuses bytes, `None` where it takes them; other errors pass."""
    path = folder / target.file
    path.write_bytes(content)
    try:
        target.read(path)
    except (ValueError, OSError) as error:
        if type(error) is not ValueError and not isinstance(error, OSError):
            raise
        message = str(error)
        assert message and "\n" not in message, message
        assert len(message) < LONGEST_MESSAGE, message
        return message
    return None


def prepare(target: Target, folder: Path) -> None:
    """Write the files that stand beside the fuzzed one."""
    for name, content in target.beside().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    (folder / target.file).parent.mkdir(parents=True, exist_ok=True)


# Seeds --------------------------------------------------------------------------------------------

SMALL = made_up(count=12)


def written(name: str, write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def table() -> pl.DataFrame:
    columns = {"time": SMALL["time"], "temperature": SMALL["temperature"], "device": ["A"] * 12}
    for key in ("accel", "gyro"):
        columns |= {f"{key}_{a}": SMALL[key][:, k] for k, a in enumerate("xyz")}
    return pl.DataFrame(columns).with_columns(position=pl.lit(0))


def csv_seeds() -> list[bytes]:
    plain = table().write_csv().encode()
    commas = table().write_csv(separator=";").replace(".", ",").encode()
    return [
        plain,
        commas,
        b"\xef\xbb\xbf" + plain.replace(b"\n", b"\r\n"),
        b"# log\n" + plain[:400],
        b"sep=,\nrate,50\nmode,0\n" + plain.replace(b"\n", b",\n"),
        b"\0\0\n%" + plain[:400].replace(b"\n0", b"\n2026-03-01T10:00:00"),
    ]


def parquet_seeds() -> list[bytes]:
    found = []
    for compression in ("uncompressed", "zstd", "snappy"):
        memory = io.BytesIO()
        table().write_parquet(memory, compression=compression)
        found.append(memory.getvalue())
    return found


def euroc_seeds() -> list[bytes]:
    stamps = (1e9 * SMALL["time"]).astype(int).tolist()
    rows = zip(stamps, SMALL["gyro"].tolist(), SMALL["accel"].tolist(), strict=True)
    return [(EUROC + "".join(",".join(map(repr, (t, *w, *a))) + "\n" for t, w, a in rows)).encode()]


def imu_tk_seeds() -> list[bytes]:
    rows = np.column_stack([SMALL["time"], SMALL["accel"]]).tolist()
    return ["\n".join(" ".join(f"{x:.6g}" for x in row) for row in rows).encode()]


LABELS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a", "x_rot", "y_rot", "z_rot")
SECTIONS = json.dumps(
    {k: {"start": 2 * i, "end": 2 * i + 2} for i, k in enumerate(LABELS)}
).encode()


def session() -> bytes:
    names = [f"{t}_{a}" for t in ("acc", "gyr") for a in "xyz"]
    rows = np.tile(np.column_stack([SMALL["accel"], SMALL["gyro"]]), (2, 1))
    return pl.DataFrame(rows, schema=names, orient="row").write_csv().encode()


def bag_file(kind: str, name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("a.bag" if kind == "ros1" else "run")
        bag(path, kind, SMALL)
        return path.read_bytes() if kind == "ros1" else next(path.glob(name)).read_bytes()


def hdf5_file(path: Path, **settings: object) -> None:
    with h5py.File(path, "w") as file:
        for name, values in SMALL.items():
            file.create_dataset(name, data=values, **settings)
        file["device"] = np.array([b"A"] * 12)


def calibrations() -> list[bytes]:
    bases = (None, Polynomial(1, -40.0, 70.0), CubicSpline((-40.0, 0.0, 70.0)))
    found = [calibration(b, d=False) for b in bases]
    return [written("c.json", lambda p, c=c: write_calibration(c, p)) for c in found]


def exported(name: str) -> list[bytes]:
    settings: dict[str, object] = dict(NOISE.get(name, {}))
    if name == "basalt":
        settings |= (
            {"frequency": 200.0} if "frequency" in by_name(name).Settings.__struct_fields__ else {}
        )
    lower = name in ("imu_tk", "basalt")
    return [
        content
        for cal in (calibration(lower=lower, d=False), calibration(diagonal=True, d=False))
        for _, content in export(cal, name, **settings).files
    ]


CAMPAIGN = b"""[site]
gravity = 9.81
latitude = 55.5
[recordings]
files = ["a.csv", "*.csv"]
start_row = 1
[columns]
time = { name = "time", unit = "s" }
accel = { names = ["accel_x", "accel_y", "accel_z"], unit = "m/s^2" }
gyro = { unit = "count", scale = [1.0, 1.0, 1.0], scale_unit = "count per rad/s", offset = 0.0 }
temperature = { name = "temperature", unit = "degC" }
[rig]
position_uncertainty = 2.0
[device]
grade = "tactical"
[model]
accel_estimator = "invariant"
g_sensitivity = false
temperature_degree = 0
"""
CAMPAIGN_WITH_PROBE = CAMPAIGN.replace(
    b"[columns]",
    b'temperature_files = ["probe.txt"]\ntemperature_delay = 0.5\n[columns]\ntemperature_time = "time"',
)
LVM = (
    b"LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\n"
    b"Y_Unit_Label\tg\tg\nDelta_X\t0,5\t0,5\n***End_of_Header***\nX_Value\tax\tay\tComment\n\t0,5\t1,0\n\t0,25\t1,0\tknocked\n"
)
NOVATEL = (
    b"%RAWIMUSA,2387,1.0;2387,1.000023576,00000077,414,291,64145,36,0,3*9319b0f1\n"
    b"#RAWIMUXA,COM1,0,68.5;04,41,2209,2.013699,ea59fe00,329308016,-2706935,4508389,196192,417138,-1000837*038422a7\n"
)
PROBE = b"time,temperature\n-9,20.5\n0.5,21\n1000,22.25\n"
SCENARIO = b"""[site]
gravity = 9.81
[plan]
programme = "8"
temperatures = [20.0]
drift = "one-sided"
change = 10.0
[device]
triads = ["accel", "gyro"]
count = 1
[recording]
rate = 10.0
seed = 4
"""
NOISE_JSON = json.dumps(
    {
        "schema": "inertiax.noise/1",
        "logs": [
            {
                "device": "SN 7",
                "rate": {"value": 200.0, "unit": "Hz"},
                "channels": {
                    f"{t}_{a}": {
                        "terms": {
                            n: {"shown": True, "value": 1e-3, "upper_95": 2e-3}
                            for n in ("N", "B", "K", "R", "Q")
                        }
                    }
                    for t in ("accel", "gyro")
                    for a in "xyz"
                },
            }
        ],
    }
).encode()


def truth_seeds() -> list[bytes]:
    curve = {
        "basis": {"kind": "chebyshev", "degree": 0, "low": -40.0, "high": 60.0, "unit": "degC"},
        "coefficients": [[0.0] * 12],
        "ripple": {"period": 20.0, "amplitude": [0.0] * 12, "phase": [0.0] * 12},
    }
    devices = {"A": {"lag": {"value": 0.0, "unit": "s"}, "accel": curve}}
    return [json.dumps({"schema": "inertiax.truth/1", "devices": devices}).encode()]


def population_seeds() -> list[bytes]:
    from inertiax.fleet.solve.triad_model import TriadModel

    fields = {f.name: f for f in msgspec.structs.fields(TriadModel)}
    model = {
        "degree": 0,
        "low": -40.0,
        "high": 60.0,
        "names": ["accel.bias[0]"],
        "estimator": "invariant",
    }
    triad = {
        "model": {k: v for k, v in model.items() if k in fields},
        "mean": [0.0],
        "covariance": [1.0],
        "mean_covariance": [0.1],
        "scatter": 1e-4,
        "devices": 9,
        "shrinkage": 0.1,
    }
    return [json.dumps({"schema": "inertiax.population/1", "accel": triad, "gyro": None}).encode()]


# Readers -----------------------------------------------------------------------------------------

RATE = ColumnMap(time=TimeColumn(rate=100.0))


def population(path: Path) -> object:
    from inertiax.fleet import read_population

    return read_population(path)


def manifest(path: Path) -> object:
    from inertiax.fleet.store import read_manifest

    return read_manifest(path.parent)


def line(path: Path) -> object:
    from inertiax.fleet import read_line_file

    return read_line_file(path.parent)


def noise_settings(path: Path) -> object:
    return settings_from_noise(path.read_bytes(), by_name("kalibr"), "SN 7")


def foreign(name: str) -> Target:
    return Target(
        f"a.{name}",
        lambda path: read_calibration_of(path.read_bytes(), name),
        lambda: exported(name),
    )


def ros2(kind: str, suffix: str) -> Target:
    return Target(
        f"run/run{suffix}",
        lambda path: read_recordings(path.parent),
        lambda: [bag_file(kind, f"*{suffix}")],
        lambda: {"run/metadata.yaml": bag_file(kind, "metadata.yaml").replace(b"run_0", b"run")},
    )


TARGETS: dict[str, Target] = {
    "csv": Target("a.csv", read_recordings, csv_seeds),
    "no_header": Target(
        "a.txt",
        lambda p: read_recordings(
            p, layout=Layout(names=("time", "accel_x", "accel_y", "accel_z"))
        ),
        imu_tk_seeds,
    ),
    "parquet": Target("a.parquet", read_recordings, parquet_seeds),
    "imu_tk": Target("a.mat", lambda p: read_recordings(p, name="imu_tk"), imu_tk_seeds),
    "euroc": Target("data.csv", lambda p: read_recordings(p, name="euroc"), euroc_seeds),
    "imucal_session": Target(
        "a.csv",
        lambda p: read_recordings(p, RATE, name="imucal"),
        lambda: [session()],
        lambda: {"a_list.json": SECTIONS},
    ),
    "imucal_sections": Target(
        "a_list.json",
        lambda p: read_recordings(p.parent / "a.csv", RATE, name="imucal"),
        lambda: [SECTIONS],
        lambda: {"a.csv": session()},
    ),
    "imucal_section_table": Target(
        "a_list.csv",
        lambda p: read_recordings(p.parent / "a.csv", RATE, name="imucal"),
        lambda: [
            "\n".join(
                ["label,start,end", *(f"{k},{2 * i},{2 * i + 2}" for i, k in enumerate(LABELS))]
            ).encode()
        ],
        lambda: {"a.csv": session()},
    ),
    "hdf5": Target(
        "a.h5",
        read_recordings,
        lambda: [
            written("a.h5", hdf5_file),
            written("a.h5", lambda p: hdf5_file(p, compression="gzip")),
        ],
    ),
    "matlab_5": Target(
        "a.mat",
        lambda p: read_recordings(p, name="matlab"),
        lambda: [
            written("a.mat", lambda p, c=c: scipy.io.savemat(p, SMALL, do_compression=c))
            for c in (False, True)
        ],
    ),
    "matlab_73": Target(
        "a.mat",
        lambda p: read_recordings(p, name="matlab"),
        lambda: [written("a.mat", lambda p: matlab_73(p, SMALL))],
    ),
    "ulog": Target(
        "a.ulg", read_recordings, lambda: [written("a.ulg", lambda p: raw_log(p, SMALL))]
    ),
    "dataflash": Target(
        "a.bin", read_recordings, lambda: [written("a.bin", lambda p: dataflash(p, SMALL))]
    ),
    "ros_1_bag": Target("a.bag", read_recordings, lambda: [bag_file("ros1", "")]),
    "ros_2_sqlite": ros2("sqlite3", ".db3"),
    "ros_2_mcap": ros2("mcap", ".mcap"),
    "ros_2_metadata": Target(
        "run/metadata.yaml",
        lambda p: read_recordings(p.parent),
        lambda: [bag_file("mcap", "metadata.yaml").replace(b"run_0", b"run")],
        lambda: {"run/run.mcap": bag_file("mcap", "*.mcap")},
    ),
    "campaign_toml": Target(
        "campaign.toml",
        load_campaign,
        lambda: [CAMPAIGN, CAMPAIGN[:60], CAMPAIGN_WITH_PROBE],
        lambda: {"a.csv": csv_seeds()[0], "probe.txt": PROBE},
    ),
    "campaign_mapping": Target(
        "campaign.toml",
        lambda path: mapping_of(path, path.with_name("a.csv")),
        lambda: [CAMPAIGN, CAMPAIGN_WITH_PROBE],
        lambda: {"a.csv": csv_seeds()[0], "probe.txt": PROBE},
    ),
    "lvm": Target("a.lvm", lambda path: csv.read_table(path), lambda: [LVM]),
    "novatel": Target("a.asc", lambda path: csv.read_table(path), lambda: [NOVATEL]),
    "temperature_log": Target(
        "probe.txt", lambda path: read_temperature_log(path, ColumnMap(), 0.5), lambda: [PROBE]
    ),
    "scenario_toml": Target("a.toml", load_scenario, lambda: [SCENARIO]),
    "calibration_json": Target("calibration.json", read_calibration, calibrations),
    "noise_json": Target("noise.json", noise_settings, lambda: [NOISE_JSON]),
    "truth_json": Target("truth.json", read_truth, truth_seeds),
    "population_json": Target("population.json", population, population_seeds),
    "fleet_manifest": Target(
        "manifest.json",
        manifest,
        lambda: [
            b'{"schema":"inertiax.fleet/1","inputs":"","gravity":9.8,"accel":null,"gyro":null,'
            b'"g_sensitivity":false,"reasons":[],"tasks":[]}'
        ],
    ),
    "fleet_line": Target(
        "line.json",
        line,
        lambda: [b'{"schema":"inertiax.fleet-line/1","triads":[]}'],
    ),
    **{
        f"from_{name}": foreign(name)
        for name in ("imu_tk", "imucal", "px4", "ardupilot", "azure", "aria", "basalt", "realsense")
    },
}
