"""Bad inputs to every command: files, arguments; the exact line each is refused with is in `bad_inputs.txt`.

In arguments `@name` is the path of a file of the case; `@out` does not exist. Each case's folder begins with a
good campaign in `good/`, a good calibration `good.json` of its device, and `good.csv`.
"""

import io
import json
import os
import pickle
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import polars as pl

from exports_cases import calibration
from inertiax.calibration.calibration import write_calibration
from inertiax.physics.temperature import Polynomial


SITE = "[site]\ngravity = 9.81\n"
TOML = SITE + '[recordings]\nfiles = ["a.*"]\n'
FACES = np.concatenate([np.eye(3), -np.eye(3)])
CORNERS = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / 3**0.5
DIRECTIONS = np.concatenate([FACES, CORNERS])


def rests(positions: int = 14, same: bool = False, seed: int = 1) -> pl.DataFrame:
    """Rests of twenty samples in so many positions, or as often in the same one; each seed another device's noise."""
    force = 9.81 * DIRECTIONS[:positions]
    force = np.repeat(force[:1] if same else force, 20 * (positions if same else 1), axis=0)
    output = (
        force + [0.1, -0.2, 0.05] + 1e-4 * np.random.default_rng(seed).standard_normal(force.shape)
    )
    number = np.repeat(np.arange(positions), 20)
    columns = {"time": 0.1 * np.arange(len(force)) + number}
    columns |= {f"accel_{a}": output[:, k].round(6) for k, a in enumerate("xyz")}
    return pl.DataFrame(columns).with_columns(position=pl.Series(number))


TABLE = rests()
CSV = TABLE.write_csv()


def line(number: int, text: str) -> str:
    lines = CSV.splitlines()
    lines[number + 1] = text
    return "\n".join(lines) + "\n"


def parquet(table: pl.DataFrame) -> bytes:
    memory = io.BytesIO()
    table.write_parquet(memory)
    return memory.getvalue()


def parquet_bomb() -> bytes:
    """Ten columns of ten million zeros: 800 MB in a few kilobytes."""
    zeros = pl.Series(np.zeros(10_000_000, np.int8))
    return parquet(pl.DataFrame({f"c{k}": zeros for k in range(10)}))


def parquet_of_one_text() -> bytes:
    """One text of 5 kB in a million rows: 5 GB written out, 20 kB as a dictionary."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    memory = io.BytesIO()
    index = pa.array(np.zeros(1_000_000, np.int32))
    columns = {
        name: pa.array(np.zeros(1_000_000)) for name in ("time", "accel_x", "accel_y", "accel_z")
    }
    columns["device"] = pa.DictionaryArray.from_arrays(index, pa.array(["x" * 5000]))
    pq.write_table(pa.table(columns), memory, compression="zstd", store_schema=False)
    return memory.getvalue()


def matlab_bomb() -> bytes:
    """A packed element of 400 MB of zeros."""
    stream = zlib.compressobj(9)
    packed = b"".join(stream.compress(bytes(1 << 20)) for _ in range(400)) + stream.flush()
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    return header + np.array([15, len(packed)], "<u4").tobytes() + packed


def zip_bomb() -> bytes:
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", bytes(10_000_000))
    return memory.getvalue()


class Harm:
    """What would run if a file were unpickled."""

    def __reduce__(self):
        return os.system, ("touch harmed",)


def pickled() -> bytes:
    memory = io.BytesIO()
    np.save(memory, np.array([Harm()], object), allow_pickle=True)
    return memory.getvalue()


def hdf5(**arrays: object) -> bytes:
    import h5py

    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return memory.getvalue()


def hdf5_bomb() -> bytes:
    """Four columns of 800 MB each that are nowhere stored."""
    import h5py

    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        for name in ("time", "accel_x", "accel_y", "accel_z"):
            file.create_dataset(name, (10**8,), "f8", chunks=(10**6,), compression="gzip")
    return memory.getvalue()


def hdf5_of_links() -> bytes:
    """Thirty groups, each a member of every other one: more paths than can be walked."""
    import h5py

    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        groups = [file.create_group(f"g{k}") for k in range(30)]
        for group in groups:
            for k, other in enumerate(groups):
                group[f"to{k}"] = other
    return memory.getvalue()


def bag_bomb() -> bytes:
    """A bag with one chunk of 300 MB of zeros."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS1_NOETIC)
    with tempfile.TemporaryDirectory() as folder:
        writer = Writer(Path(folder) / "a.bag")
        writer.set_compression(Writer.CompressionFormat.LZ4)
        with writer:
            topic = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            writer.write(topic, 1, bytes(300_000_000))
        return (Path(folder) / "a.bag").read_bytes()


def written_by(make: Callable[[], bytes]) -> Callable[[Path], object]:
    """A file that is only made when its case runs."""
    return lambda path: path.write_bytes(make())


def good_calibration(*, thermal: bool = True, **changes: object) -> bytes:
    """calibration.json with changed keys; a key of several parts goes into tables."""
    made = calibration(Polynomial(1, -40.0, 70.0) if thermal else None, d=False)
    path = Path(tempfile.gettempdir()) / f"inertiax-{os.getpid()}.json"
    write_calibration(made, path)
    document = json.loads(path.read_text())
    path.unlink()
    for key, value in changes.items():
        place = document
        *tables, last = key.split("__")
        for table in tables:
            place = place[table]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return json.dumps(document).encode()


Content: TypeAlias = bytes | str | Callable[[Path], object]


class Case(NamedTuple):
    """Arguments, and files by name: content, or a function that makes the file."""

    arguments: str
    files: dict[str, Content] = {}


def recorded(
    content: Content, *, name: str = "a.csv", toml: str = TOML, command: str = "calibrate"
):
    """A campaign of one recording."""
    return Case(f"{command} @c -o @out", {"c/campaign.toml": toml, f"c/{name}": content})


def told(toml: str | bytes) -> Case:
    """A campaign of a good recording."""
    return Case("calibrate @c -o @out", {"c/campaign.toml": toml, "c/a.csv": CSV})


def columns(text: str) -> Case:
    return told(f"{TOML}[columns]\n{text}\n")


def compensated(document: bytes | str, recording: str = "@good.csv") -> Case:
    return Case(f"compensate @c.json {recording} -o @out.csv", {"c.json": document})


def scenario(text: str) -> Case:
    return Case("simulate @s.toml -o @out", {"s.toml": text})


def loop(path: Path) -> None:
    path.symlink_to(path.name)


def pipe(path: Path) -> None:
    os.mkfifo(path)


FLEET = {
    "c/campaign.toml": TOML,
    "c/a.parquet": parquet(
        pl.concat(
            [rests(seed=k).with_columns(device=pl.lit(d)) for k, d in enumerate("ABCDEF", start=1)]
        )
    ),
}
GLOB = SITE + "[recordings]\nfiles = [{!r}]\n"
CALIBRATED = good_calibration(thermal=False)

CASES: dict[str, Case] = {
    # calibrate: what is in a recording
    "wrong unit": recorded(TABLE.with_columns(pl.col("^accel.*$") / 9.80665).write_csv()),
    "missing column": recorded(TABLE.drop("accel_z").write_csv()),
    "NaN": recorded(line(5, "0.5,nan,0.0,9.8,0")),
    "infinity": recorded(line(5, "0.5,inf,0.0,9.8,0")),
    "number beyond doubles": recorded(line(5, "0.5,1e999,0.0,9.8,0")),
    "saturated axis in all positions": recorded(
        TABLE.with_columns(accel_x=pl.lit(2.0)).write_csv()
    ),
    "too few positions": recorded(rests(4).write_csv()),
    "one position only": recorded(rests(14, same=True).write_csv()),
    "one sample": recorded("\n".join(CSV.splitlines()[:2]) + "\n"),
    "truncated CSV": recorded(CSV[:-12]),
    "truncated Parquet": recorded(parquet(TABLE)[:-30], name="a.parquet"),
    "empty recording": recorded(""),
    "names twice": recorded(CSV.replace("accel_y", "accel_x", 1)),
    "time goes back": recorded(line(5, "0.2,0.1,0.0,9.8,0")),
    "UTF-16 recording": recorded(CSV.encode("utf-16")),
    "shapes that do not fit": recorded(
        hdf5(time=np.arange(40) * 0.1, accel=np.ones((39, 3))), name="a.h5"
    ),
    "Parquet bomb": recorded(written_by(parquet_bomb), name="a.parquet"),
    "Parquet of one long text": recorded(written_by(parquet_of_one_text), name="a.parquet"),
    "MATLAB bomb": recorded(written_by(matlab_bomb), name="a.mat"),
    "HDF5 bomb": recorded(written_by(hdf5_bomb), name="a.h5"),
    "HDF5 of links in circles": recorded(written_by(hdf5_of_links), name="a.h5"),
    "bag bomb": recorded(written_by(bag_bomb), name="a.bag"),
    "zip bomb in npz": recorded(zip_bomb(), name="a.npz"),
    "zip bomb in xlsx": recorded(zip_bomb(), name="a.xlsx"),
    "pickle in npy": recorded(pickled(), name="a.npy"),
    "pickle": recorded(pickle.dumps(Harm()), name="a.pkl"),
    "text of many columns": recorded(
        ",".join(f"c{k}" for k in range(20000)) + "\n" + "1," * 19999 + "1\n"
    ),
    "terminal codes in a name": recorded(CSV.replace("accel_y", "\x1b[2Jaccel_y", 1)),
    "position number beyond integers": recorded(line(5, "0.5,0.1,0.0,9.8,1e30")),
    "link to itself": Case("calibrate @c -o @out", {"c/campaign.toml": TOML, "c/a.csv": loop}),
    "pipe": Case("calibrate @c -o @out", {"c/campaign.toml": TOML, "c/a.csv": pipe}),
    "dates for time": recorded(CSV.replace("\n0.0,", "\n2026-01-01,", 1)),
    "broken ULog": recorded(b"ULog\x01\x12\x35\x01" + bytes(8) + b"\x10\x00", name="a.ulg"),
    "broken dataflash": recorded(b"\xa3\x95\x80" + bytes(100), name="a.bin"),
    "broken bag": recorded(b"#ROSBAG V2.0\n" + bytes(40), name="a.bag"),
    "broken HDF5": recorded(b"\x89HDF\r\n\x1a\n" + bytes(40), name="a.h5"),
    # calibrate: campaign.toml
    "unknown key": told(TOML.replace("gravity", "gravty")),
    "UTF-16 campaign": told(TOML.encode("utf-16")),
    "key twice": told(SITE + "gravity = 9.8\n"),
    "nested without end": told(SITE + "x = " + "[" * 5000),
    "sampling rate below zero": columns("time = { rate = -100.0 }"),
    "sampling rate of nan": columns("time = { rate = nan }"),
    "sampling rate of infinity": columns("time = { rate = inf }"),
    "gravity of nan": told(TOML.replace("9.81", "nan")),
    "gravity of whole numbers too large": told(TOML.replace("9.81", "9" * 400)),
    "unit misspelt": columns('accel = { unit = "m/s" }'),
    "names of one column": columns('accel = { names = ["accel_x", "accel_x", "accel_x"] }'),
    "glob out of the folder": told(GLOB.format("../*/*.csv")),
    "glob from the root": told(GLOB.format("/etc/*")),
    "file of the system": told(GLOB.format("/etc/passwd")),
    "null in a file's name": told(SITE + '[recordings]\nfiles = ["a\\u0000.csv"]\n'),
    "name too long for a file": told(GLOB.format("x" * 5000)),
    "glob of brackets": told(GLOB.format("[")),
    "two stars in a name": told(GLOB.format("a**b/*.csv")),
    "start_row beyond the file": told(TOML + "start_row = 99999999999999999999\n"),
    "degree of a million": told(TOML + "[model]\ntemperature_degree = 1000000\n"),
    "uncertainty of nan": told(TOML + "[rig]\nposition_uncertainty = nan\n"),
    "campaign.toml is a folder": Case("calibrate @c -o @out", {"c/campaign.toml/x": ""}),
    "recording for a campaign": Case("calibrate @good.csv -o @out"),
    "no such campaign": Case("calibrate @none -o @out"),
    "folder without campaign": Case("calibrate @c -o @out", {"c/a.csv": CSV}),
    # where results go
    "output is a file": Case("calibrate @good -o @good.csv"),
    "output below a file": Case("calibrate @good -o @good.csv/below"),
    "output is a device": Case("calibrate @good -o /dev/full"),
    "table into a folder": Case("compensate @good.json @good.csv -o @good/x/", {"good/x/y": ""}),
    "table into /proc": Case("compensate @good.json @good.csv -o /proc/x.csv"),
    "export into /dev/full": Case("export @good.json --to kalibr -o /dev/full/x"),
    "compensate over its recording": Case("compensate @good.json @good.csv -o @good.csv"),
    "compensate over a campaign's recording": Case(
        "compensate @good.json @good.csv -o @good/a.csv", {"good/a.csv": CSV}
    ),
    "export over its calibration": Case("export @good.json --to c -o @good.json"),
    "export over a log": Case("export @good.json --to c -o @good.csv"),
    "simulate into a full folder": Case("simulate paper-check -o @good"),
    # compensate
    "calibration is no JSON": compensated("no JSON"),
    "calibration is empty": compensated(""),
    "calibration in UTF-16": compensated(good_calibration().decode().encode("utf-16")),
    "calibration of a later schema": compensated(good_calibration(schema="inertiax.calibration/9")),
    "calibration without gravity": compensated(good_calibration(gravity=None)),
    "calibration with gravity of text": compensated(good_calibration(gravity="9.8")),
    "calibration with gravity below zero": compensated(good_calibration(gravity=-9.8)),
    "calibration with an unknown key": compensated(good_calibration(extra=1)),
    "calibration in other units": compensated(good_calibration(gravity_unit="g")),
    "calibration with temperatures reversed": compensated(
        good_calibration(temperature_range=[70, -40])
    ),
    "calibration with an unknown basis": compensated(good_calibration(accel__basis__kind="pickle")),
    "calibration of a huge degree": compensated(good_calibration(accel__basis__degree=10**9)),
    "calibration of a degree below zero": compensated(good_calibration(accel__basis__degree=-1)),
    "calibration of an empty interval": compensated(good_calibration(accel__basis__low=70.0)),
    "calibration with a number beyond doubles": compensated(
        good_calibration().replace(b"9.815", b"1e999", 1)
    ),
    "calibration with brackets without end": compensated('{"schema": ' + "[" * 100000),
    "calibration with other shapes": compensated(good_calibration(accel__coefficients=[[1.0]])),
    "calibration with other names": compensated(
        good_calibration(accel__names=["accel.bias[7]"] * 12)
    ),
    "calibration with text for notes": compensated(good_calibration(notes="<script>")),
    "calibration of a folder": Case("compensate @good @good.csv -o @out.csv"),
    "compensate without temperature": compensated(good_calibration()),
    "compensate into a spreadsheet": Case("compensate @good.json @good.csv -o @out.xlsx"),
    "compensate two devices": Case(
        "compensate @good.json @b.csv -o @out.csv",
        {"b.csv": pl.concat([TABLE.with_columns(device=pl.lit(d)) for d in "AB"]).write_csv()},
    ),
    "compensate what is no recording": Case(
        "compensate @good.json @b.xyz -o @out.csv", {"b.xyz": b"\0\1"}
    ),
    "compensate by a broken campaign": Case(
        "compensate @good.json @good.csv -o @out.csv --campaign @c.toml", {"c.toml": "[columns"}
    ),
    "compensate by columns that are no table": Case(
        "compensate @good.json @good.csv -o @out.csv --campaign @c.toml", {"c.toml": "columns = 3"}
    ),
    # diagnose
    "diagnose an empty file": recorded("", command="diagnose"),
    "diagnose without time": recorded(TABLE.drop("time").write_csv(), command="diagnose"),
    "diagnose by a broken calibration": Case(
        "diagnose @good -o @out --calibration @c.json", {"c.json": "{}"}
    ),
    "diagnose several by one calibration": Case(
        "diagnose @c -o @out --calibration @good.json",
        {
            "c/campaign.toml": TOML,
            "c/a.csv": pl.concat([TABLE.with_columns(device=pl.lit(d)) for d in "AB"]).write_csv(),
        },
    ),
    # design
    "design nothing": Case("design"),
    "design both": Case("design @good --audit --optimise"),
    "audit nothing": Case("design --audit"),
    "audit what is not there": Case("design paper-sett-1 --audit"),
    "few positions": Case("design --optimise --positions 3"),
    "temperatures reversed": Case("design --optimise --low 60 --high -55"),
    "precision below zero": Case("design --optimise --target -1"),
    "unknown criterion": Case("design --optimise --criterion E"),
    "separate what is not there": Case("design --separate nothing.json"),
    "separate and audit": Case("design @good --audit --separate nothing.json"),
    # export
    "export nothing": Case("export"),
    "unknown format": Case("export @good.json --to kalibrr"),
    "unknown setting": Case("export @good.json --to kalibr --set x=1"),
    "setting without a value": Case("export @good.json --to kalibr --set x"),
    "setting of text": Case("export @good.json --to kalibr --set update_rate=fast"),
    "missing noise": Case("export @good.json --to kalibr -o @out.yaml"),
    "noise of another kind": Case(
        "export @good.json --to kalibr --noise @n.json", {"n.json": '{"schema": "x", "logs": []}'}
    ),
    "import of what is no JSON": Case("export @a.json --from azure --to inertiax", {"a.json": "x"}),
    "import of another JSON": Case("export @a.json --from aria --to inertiax", {"a.json": "[]"}),
    "import of an empty file": Case("export @a.txt --from px4 --to inertiax", {"a.txt": ""}),
    "import of words": Case("export @a.txt --from imu_tk --to inertiax", {"a.txt": "a b c"}),
    "import of what cannot be read": Case("export @a.txt --from c --to inertiax", {"a.txt": ""}),
    # fleet, noise, simulate, demo
    "fleet of what is not there": Case("fleet @none -o @out"),
    "fleet of CSV": Case("fleet @good -o @out"),
    "fleet with a broken prior": Case(
        "fleet @c -o @out --prior @p.json", {**FLEET, "p.json": "{}"}
    ),
    "fleet with a later prior": Case(
        "fleet @c -o @out --prior @p.json",
        {**FLEET, "p.json": '{"schema": "inertiax.population/9"}'},
    ),
    "fleet at no temperature": Case("fleet @c -o @out --at cold", FLEET),
    "fleet in a damaged folder": Case("fleet @c -o @f", {**FLEET, "f/manifest.json": b"\xff\xfe"}),
    "fleet of a cut off file": Case(
        "fleet @c -o @out", {**FLEET, "c/a.parquet": FLEET["c/a.parquet"][:-20]}
    ),
    "noise of a short log": Case(
        "noise @b.csv -o @out", {"b.csv": "\n".join(CSV.splitlines()[:4])}
    ),
    "noise of what is no recording": Case("noise @good.json -o @out"),
    "unknown scenario": Case("simulate paper-set-9 -o @out"),
    "scenario with an unknown key": scenario("[plan]\nprogram = '8'\n"),
    "scenario with a rate of nan": scenario("[recording]\nrate = nan\n"),
    "scenario of absurd size": scenario("[recording]\nrate = 1e15\n"),
    "scenario of too many devices": scenario("[device]\ncount = 1000000000\n"),
    "scenario of a huge degree": scenario("[device]\ndegree = 100000000\n"),
    "scenario is a folder": Case("simulate @good -o @out"),
    "demo of a seed below zero": Case("demo --seed -1 -o @out"),
    # protocol
    "protocol of a campaign": Case("protocol @good -o @out"),
    "protocol of what is not there": Case("protocol @none -o @out"),
    "protocol of a file": Case("protocol @good.json -o @out"),
    "protocol without a record": Case("protocol @r -o @out", {"r/calibration.json": CALIBRATED}),
    "protocol of a damaged record": Case(
        "protocol @r -o @out", {"r/calibration.json": CALIBRATED, "r/record.json": '{"schema": 1}'}
    ),
    "protocol of a later record": Case(
        "protocol @r -o @out",
        {"r/calibration.json": CALIBRATED, "r/record.json": '{"schema": "inertiax.record/9"}'},
    ),
    "protocol of a damaged calibration": Case("protocol @r -o @out", {"r/calibration.json": "{"}),
    "protocol of a fleet without a device": Case(
        "protocol @f -o @out", {"f/manifest.json": b"\xff\xfe"}
    ),
    "protocol at no temperature": Case("protocol @good -o @out --at cold"),
    "protocol with requirements that are no TOML": Case(
        "protocol @good -o @out --requirements @q.toml", {"q.toml": b"\xff\x00"}
    ),
    "protocol with an unknown table": Case(
        "protocol @good -o @out --requirements @q.toml", {"q.toml": "[requirement]\n"}
    ),
    "live with a target misspelt": Case("live @good - --target accel.bais=1mg -o @out"),
    "live with a target without a unit": Case("live @good - --target accel.bias=1 -o @out"),
    "live with a target below zero": Case("live @good - --target accel.bias=-1mg -o @out"),
    "unknown command": Case("calibrat @good -o @out"),
    "unknown option": Case("calibrate @good -o @out --jsn"),
}
