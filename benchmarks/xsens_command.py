"""Wall time of the whole `inertiax calibrate` command on imu_tk's Xsens recording.

imu_tk's own program takes 0.74–0.78 s on this recording (2 cores): it loads both files, tries nine thresholds,
calibrates accelerometers and gyros, and draws nothing. The command here does the same and writes the report with its
figures; it compiles its programs on the first run and finds them in the cache on the next.

    INERTIAX_RECORDINGS=... python benchmarks/xsens_command.py

Prints the median of five runs with an empty and with a filled compilation cache.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


CAMPAIGN = """
[site]
gravity = 9.81744
[recordings]
files = ["xsens_acc.mat"]
gyro_files = ["xsens_gyro.mat"]
[columns]
accel = { unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2" }
gyro = { unit = "count", offset = 32768, scale = [4778, 4758, 4766], scale_unit = "count per rad/s" }
"""


def one_run(folder: Path, cache: Path) -> float:
    """Seconds from start to exit of the command, in its own process."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    started = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "inertiax", "calibrate", str(folder), "-o", str(folder / "out")],
        check=True,
        capture_output=True,
        env=environment,
    )
    return time.perf_counter() - started


def main() -> None:
    source = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    with tempfile.TemporaryDirectory() as name:
        folder, cache = Path(name) / "xsens", Path(name) / "cache"
        folder.mkdir()
        for file in ("xsens_acc.mat", "xsens_gyro.mat"):
            shutil.copy(source / file, folder)
        (folder / "campaign.toml").write_text(CAMPAIGN)
        cold, warm = [], []
        for _ in range(5):
            shutil.rmtree(cache, ignore_errors=True)
            cold.append(one_run(folder, cache))
            warm.append(one_run(folder, cache))
    for label, runs in (("empty cache", cold), ("filled cache", warm)):
        print(f"{label}: median {statistics.median(runs):.2f} s ({min(runs):.2f}…{max(runs):.2f})")
    print("imu_tk, as measured by its users on two cores: 0.74…0.78 s, without a report")


if __name__ == "__main__":
    main()
