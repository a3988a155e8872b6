"""What an installed inertiax must do, whatever its dependencies' versions; run by `run.sh` in a clean environment."""

import importlib.metadata
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import inertiax


GRAVITY = 9.81
BIAS = np.array([0.1, -0.2, 0.05])


def campaign(folder: Path) -> Path:
    """Fourteen rests of a triad with a bias and slightly wrong scale factors."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / 3**0.5
    force = np.repeat(GRAVITY * np.concatenate([faces, corners]), 20, axis=0)
    output = force * [1.001, 0.999, 1.002] + BIAS
    output += 1e-4 * np.random.default_rng(0).standard_normal(output.shape)
    number = np.repeat(np.arange(14), 20)
    time = 0.1 * np.arange(len(force)) + number
    lines = ["time,accel_x,accel_y,accel_z,position"]
    lines += [
        f"{t:.2f},{a:.6f},{b:.6f},{c:.6f},{n}" for t, (a, b, c), n in zip(time, output, number)
    ]
    (folder / "a.csv").write_text("\n".join(lines) + "\n")
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.csv"]\n'
    )
    return folder


def main() -> None:
    assert inertiax.__version__ == importlib.metadata.version("inertiax")
    for name in dir(inertiax):
        getattr(inertiax, name)
    command = str(Path(sys.executable).with_name("inertiax"))
    told = subprocess.run([command, "--help"], check=True, capture_output=True, text=True)
    assert "calibrate" in told.stdout and not told.stderr
    with tempfile.TemporaryDirectory() as temporary:
        folder = campaign(Path(temporary))
        out = folder / "out"
        done = subprocess.run(
            [command, "calibrate", str(folder), "-o", str(out), "--json", "--quiet"],
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        assert not done.stderr, done.stderr
        assert json.loads(done.stdout)["devices"][0]["status"] == "calibrated"
        bias = inertiax.read_calibration(out / "calibration.json").accel_errors(20.0).bias
        assert np.allclose(bias, BIAS, atol=1e-3), bias
        assert (out / "report.html").stat().st_size > 1000


if __name__ == "__main__":
    main()
