"""A small calibration from cold: `inertiax calibrate` beside a SciPy script of the same work.

One campaign (162 500 rows of CSV in 13 files, 234 dwells, 63 unknowns), a process each. Both read the
files, reduce them to dwell means, solve the joint least squares of |a| = g with curves of degree 6,
estimate the covariance, and write JSON and three figures as SVG and PNG. inertiax also checks the data, judges
the result and writes a page. "First" has an empty cache of compiled programs, as a user's first run has.

    python benchmarks/scipy_calibration.py [--repeats 3] [--json FILE]
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


GRAVITY = 9.815179
DEGREE = 6
ROWS, COLUMNS = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)


def peer(folder: Path, out: Path) -> None:
    """The SciPy script: everything that it imports is imported here, in its own process."""
    import numpy as np
    import polars as pl
    from scipy.optimize import least_squares

    table = pl.concat(
        pl.read_csv(file).with_columns(run=pl.lit(k))
        for k, file in enumerate(sorted(folder.glob("*.csv")))
    )
    names = ["accel_x", "accel_y", "accel_z"]
    rests = table.filter(pl.col("position") >= 0)
    dwells = (
        rests.group_by("run", "position", maintain_order=True)
        .agg(
            pl.col("time").mean(),
            pl.col("temperature").mean(),
            *(pl.col(n).mean() for n in names),
            *(pl.col(n).var().alias(f"{n}_var") / pl.len() for n in names),
        )
        .sort("run", "time")
    )
    output = dwells.select(names).to_numpy()
    sigma = np.sqrt(dwells.select(f"{n}_var" for n in names).to_numpy().mean())
    temperature = dwells["temperature"].to_numpy()
    low, high = temperature.min(), temperature.max()
    basis = lambda t: np.polynomial.chebyshev.chebvander(
        (2 * np.asarray(t) - low - high) / (high - low), DEGREE
    )
    phi = basis(temperature)

    def residual(unknowns):
        values = phi @ unknowns.reshape(DEGREE + 1, 9)
        matrix = np.tile(np.eye(3), (len(values), 1, 1))
        matrix[:, ROWS, COLUMNS] += values[:, 3:]
        force = np.linalg.solve(matrix, (output - values[:, :3])[..., None])[..., 0]
        return (np.linalg.norm(force, axis=1) - GRAVITY) / sigma

    start = np.zeros((DEGREE + 1) * 9)
    found = least_squares(residual, start, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    grid = np.linspace(low, high, 161)
    curves = basis(grid) @ found.x.reshape(DEGREE + 1, 9)
    bands = np.sqrt(
        np.einsum(
            "ta,aibi,tb->ti", basis(grid), covariance.reshape((DEGREE + 1, 9) * 2), basis(grid)
        )
    )
    out.mkdir(exist_ok=True)
    _draw(grid, curves, bands, dwells, sigma * residual(found.x), output, out)
    middle = basis([(low + high) / 2])[0]
    document = {
        "temperature": (low + high) / 2,
        "parameters": (middle @ found.x.reshape(DEGREE + 1, 9)).tolist(),
        "sigma": bands[80].tolist(),
        "coefficients": found.x.tolist(),
        "covariance": covariance.tolist(),
    }
    (out / "calibration.json").write_text(json.dumps(document))


def _draw(grid, curves, bands, dwells, misfit, output, out: Path) -> None:
    """The figures of a calibration's report: curves with bands, misfit in three ways, directions."""
    from matplotlib.figure import Figure

    first = Figure((7.2, 2.9), layout="constrained")
    groups = ((0, 1, 2), (3, 5, 8), (4, 6, 7))
    for ax, members in zip(first.subplots(1, 3), groups, strict=True):
        for k in members:
            ax.fill_between(grid, curves[:, k] - 2 * bands[:, k], curves[:, k] + 2 * bands[:, k])
            ax.plot(grid, curves[:, k], label=str(k))
        ax.legend()
    second = Figure((7.2, 6.6), layout="constrained")
    places = (range(len(misfit)), dwells["temperature"], dwells["position"])
    for ax, place in zip(second.subplots(3, 1), places, strict=True):
        ax.errorbar(place, misfit, 1e-5, fmt="o")
    third = Figure((7.2, 3.4), layout="constrained")
    for ax, sign in zip(third.subplots(1, 2), (1, -1), strict=True):
        up = output[sign * output[:, 2] >= 0]
        ax.plot(up[:, 0], up[:, 1], "o")
    for k, figure in enumerate((first, second, third)):
        figure.savefig(out / f"{k}.svg")
        figure.savefig(out / f"{k}.png", dpi=160)


def child(command: list[str], cache: Path) -> tuple[float, float]:
    """Wall and processor seconds of one process."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "MPLCONFIGDIR": str(cache)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    start = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    _, status, used = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{command[0]} failed")
    return time.perf_counter() - start, used.ru_utime + used.ru_stime


def campaign(folder: Path) -> None:
    """The paper's set 1 as CSV."""
    import polars as pl

    run = [sys.executable, "-m", "inertiax", "simulate", "paper-set-1", "-o", str(folder), "-q"]
    subprocess.run(run, check=True)
    for file in folder.glob("*.parquet"):
        pl.read_parquet(file).write_csv(file.with_suffix(".csv"))
        file.unlink()
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace(".parquet", ".csv"))


def difference(ours: Path, theirs: Path) -> float:
    """The largest difference of the parameters in mid range, in the peer's standard deviations."""
    import numpy as np

    from inertiax import read_calibration

    told = json.loads(theirs.read_text())
    triad = read_calibration(ours).accel
    assert triad is not None
    values = np.asarray(triad.curve(told["temperature"]))
    return float(np.max(np.abs(values - told["parameters"]) / told["sigma"]))


def main() -> None:
    """Make the campaign, time all, print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        campaign(home / "set")
        theirs = [sys.executable, __file__, "peer", str(home / "set"), str(home / "theirs")]
        ours = [sys.executable, "-m", "inertiax", "calibrate", str(home / "set"), "-q"]
        ours += ["-o", str(home / "ours")]
        child(theirs, home / "fonts")  # files into memory, matplotlib's list of fonts
        first = [child(ours, home / f"empty-{k}") for k in range(chosen.repeats)]
        rows = {
            "SciPy script": [child(theirs, home / "fonts") for _ in range(chosen.repeats)],
            "inertiax, first run": first,
            "inertiax, later runs": [child(ours, home / "empty-0") for _ in range(chosen.repeats)],
        }
        apart = difference(home / "ours" / "calibration.json", home / "theirs" / "calibration.json")
    middle = {
        name: [statistics.median(t[k] for t in times) for k in (0, 1)]
        for name, times in rows.items()
    }
    base = middle["SciPy script"]
    print(f"{'':22}{'wall, s':>10}{'CPU, s':>10}{'CPU ratio':>12}")
    for name, (wall, used) in middle.items():
        print(f"{name:22}{wall:10.2f}{used:10.2f}{used / base[1]:12.2f}")
    cold, warm = middle["inertiax, first run"][1], middle["inertiax, later runs"][1]
    print(f"compiling: {100 * (cold - warm) / cold:.0f} % of the first run's processor time")
    print(f"parameters in mid range differ by at most {apart:.2f} of the script's 1 sigma")
    if chosen.json:
        chosen.json.write_text(json.dumps({"rows": rows, "apart_sigma": apart}, indent=1))


if __name__ == "__main__":
    if sys.argv[1:2] == ["peer"]:
        peer(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
