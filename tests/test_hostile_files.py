"""Thirty hostile files of each format: none takes 10 s of a processor or 1 GB, and each is read or refused in one line.

Of each format: valid small files cut off, with bytes changed, inserted, repeated, or with odd values in the place of
numbers and names (`fuzz.mutate`); and what no chance makes, files of kilobytes that claim gigabytes.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


for library in ("h5py", "pyulog", "rosbags"):
    pytest.importorskip(library, reason="inertiax[formats] is not installed")
pytest.importorskip("resource", reason="limits of POSIX")

from bad_inputs_cases import (  # noqa: E402
    bag_bomb,
    hdf5_bomb,
    hdf5_of_links,
    matlab_bomb,
    parquet_bomb,
    parquet_of_one_text,
)
from fuzz.targets import TARGETS  # noqa: E402


MADE = 30  # files by chance, of each format
SECONDS = 10.0  # of processor time, for one file
BYTES = 1e9  # of the process, libraries included

# What chance does not make, by reader.
CLAIMS = {
    "parquet": (parquet_bomb, parquet_of_one_text),
    "hdf5": (hdf5_bomb, hdf5_of_links),
    "matlab_73": (hdf5_bomb, hdf5_of_links),
    "matlab_5": (matlab_bomb,),
    "ros_1_bag": (bag_bomb,),
    "csv": (lambda: b"a," * 10**6 + b"\n" + b"1," * 10**6, lambda: b"time\n" + b"9" * 10**7),
    "ulog": (lambda: b"ULog\x01\x12\x35\x01" + bytes(8) + b"\xff\xffF" * 10**6,),
    "dataflash": (lambda: b"\xa3\x95\x80" * 10**6,),
}
# By the process in which they are read, whose memory the system counts; a start of Python costs more than thirty files.
TOGETHER = {
    "arrays": ("parquet", "hdf5", "matlab_5", "matlab_73"),
    "ros": ("ros_1_bag", "ros_2_sqlite", "ros_2_mcap", "ros_2_metadata"),
    "others": ("csv", "no_header", "imu_tk", "euroc", "imucal_session", "imucal_sections", "imucal_section_table",
               "ulog", "dataflash", "campaign_toml", "campaign_mapping", "temperature_log", "lvm", "novatel",
               "scenario_toml", "calibration_json",
               "noise_json", "truth_json", "population_json", "fleet_manifest", "fleet_line",
               *(name for name in TARGETS if name.startswith("from_"))),
}  # fmt: skip
ATTEMPTS = """
import json, random, resource, sys, time
from pathlib import Path
from fuzz.mutate import change_of, of_bytes
from fuzz.targets import attempt, prepare, TARGETS

made, folder = int(sys.argv[1]), Path(sys.argv[2])
told = {}
for name in sys.argv[3:]:
    target, place = TARGETS[name], folder / name
    prepare(target, place)
    seeds, chance = target.seeds(), random.Random(name)
    files = {f"by chance {k}": (change_of(target.file) if k % 2 else of_bytes)(chance.choice(seeds), chance)
             for k in range(made)}
    files |= {claim.name: claim.read_bytes() for claim in folder.glob(f"{name}.claim-*")}
    for what, content in files.items():
        start = time.process_time()
        refused = attempt(target, place, content)
        told[f"{name}, {what}"] = time.process_time() - start, refused is not None
# The system's count of a process's peak begins at what its parent held when it forked; that of its memory does not.
status = Path("/proc/self/status")
if status.exists():
    (line,) = [x for x in status.read_text().splitlines() if x.startswith("VmHWM:")]
    peak = 1024 * int(line.split()[1])
else:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
print(json.dumps({"files": told, "peak": peak}))
"""


@pytest.mark.slow
@pytest.mark.parametrize("group", TOGETHER)
def test_hostile_files_are_read_or_refused_in_a_line_soon_and_in_little_memory(group, tmp_path):
    names, claims = TOGETHER[group], []
    for name in names:
        (tmp_path / name).mkdir()
        for k, make in enumerate(CLAIMS.get(name, ())):
            claims.append(f"{name}, {name}.claim-{k}")
            (tmp_path / f"{name}.claim-{k}").write_bytes(make())
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", ATTEMPTS, str(MADE), str(tmp_path), *names],
        capture_output=True, text=True, timeout=600,
        env={**os.environ, "PYTHONPATH": path, "JAX_ENABLE_X64": "1"},
    )  # fmt: skip
    # Whatever is not one line is raised by `attempt`, and nothing else is said.
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    found = json.loads(done.stdout)
    assert len(found["files"]) == MADE * len(names) + len(claims)
    assert {what: took for what, (took, _) in found["files"].items() if took > SECONDS} == {}
    assert found["peak"] < BYTES, found["peak"]
    assert all(found["files"][claim][1] for claim in claims)  # refused


def test_every_reader_is_tried():
    assert sorted(name for names in TOGETHER.values() for name in names) == sorted(TARGETS)
