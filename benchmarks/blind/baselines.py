"""Naive diagnoses of the same cases: what regression on residuals gives without the physics of noise.

    python benchmarks/blind/baselines.py CASES -o RUNS --method ols | stepwise | lasso

Each reads the campaign, reduces it to block means, fits the calibration by ordinary least squares and
scores regression columns as if blocks were independent. Writes the same `diagnosis.json` (the parts
that the method has), so that `score.py` marks all alike.
"""

import argparse
import json
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from scipy import stats
from scipy.linalg import lstsq


Terms = list[tuple[str, int, np.ndarray]]  # name, channel, (n, q) columns on the residual rows


@dataclass
class Regression:
    """One triad: residual rows, their calibration columns, candidate terms."""

    triad: str
    y: np.ndarray
    base: np.ndarray
    terms: Terms


def read(folder: Path) -> tuple[dict, pl.DataFrame]:
    """Settings and log of a campaign; files in order of time."""
    settings = tomllib.loads((folder / "campaign.toml").read_text())
    frames = [pl.read_parquet(f) for f in sorted(folder.glob("*.parquet"))]
    parts = [f.with_columns(session=pl.lit(k)) for k, f in enumerate(frames)]
    return settings, pl.concat(parts).sort("time")


def three(frame: pl.DataFrame, prefix: str) -> np.ndarray | None:
    names = [f"{prefix}_{a}" for a in "xyz"]
    return frame.select(names).to_numpy() if names[0] in frame.columns else None


def segments(frame: pl.DataFrame, rests_only: bool) -> list[np.ndarray]:
    """Blocks of rows: rests, and plateaus (steady reference rate), in pieces of at most 40 rows."""
    position = frame["position"].to_numpy()
    label = position.astype(float)
    reference = three(frame, "reference_gyro")
    if reference is not None and not rests_only:
        change = np.abs(np.diff(reference, axis=0, prepend=reference[:1])).max(axis=1)
        steady = (change < 2e-4) & (np.abs(reference).max(axis=1) > 3e-4)
        which = np.round(reference, 2) @ np.array([1.0, 1e2, 1e4])
        label = np.where((position < 0) & steady, 1e7 + which, label)
    breaks = (np.diff(label) != 0) | (np.diff(frame["session"].to_numpy()) != 0)
    out = []
    for rows in np.split(np.arange(len(label)), np.flatnonzero(breaks) + 1):
        if label[rows[0]] != -1 and len(rows) >= 6:
            out += np.array_split(rows, max(int(np.ceil(len(rows) / 40)), min(4, len(rows) // 6)))
    return out


def drivers(frame: pl.DataFrame, blocks, degree: int) -> dict[str, np.ndarray]:
    """Temperature, its rate, time and so on, as block means; scaled to about one."""
    mean = lambda x: np.array([x[b].mean() for b in blocks])
    time_, temp = frame["time"].to_numpy(), frame["temperature"].to_numpy()
    window = np.ones(41) / 41
    smooth = np.convolve(np.pad(temp, 20, mode="edge"), window, mode="valid")
    slope = np.gradient(smooth, time_)
    session = frame["session"].to_numpy()
    first = np.array([time_[session == s][0] for s in range(session.max() + 1)])
    span = max(np.ptp(temp), 1e-9)
    scaled = (2 * temp - temp.min() - temp.max()) / span
    return {
        "scaled": mean(scaled), "rate": mean(slope) / max(np.abs(slope).max(), 1e-12),
        "branch": mean(np.sign(np.where(np.abs(slope) > 1e-3, slope, 0.0))),
        "time": mean(time_) / time_[-1], "since": mean(time_ - first[session]),
        "moving": np.array(float(span > 5)), "degree": np.array(float(degree)),
    }  # fmt: skip


def common_terms(d: dict[str, np.ndarray]) -> dict[str, list[np.ndarray]]:
    """Columns that any channel may have: by name, one array per value of the grid."""
    out = {
        "drift": [d["time"]],
        "warm_up": [np.exp(-d["since"] / tau) for tau in (60, 200, 600, 1500)],
        "bias_step": [(d["time"] > x) * 1.0 for x in np.linspace(0.1, 0.9, 17)],
    }
    if d["moving"] > 0:
        x, degree = d["scaled"], int(d["degree"])
        name = "temperature_order" if degree else "temperature_dependence"
        out[name] = [np.cos((degree + 1) * np.arccos(np.clip(x, -1, 1)))]
        out["temperature_rate"] = [d["rate"]]
        out["thermal_lag"] = [d["rate"] * (1 + x)]
        out["thermal_hysteresis"] = [d["branch"], d["branch"] * (1 - x**2)]
    return out


def accel_terms(f: np.ndarray, c: int) -> dict[str, list[np.ndarray]]:
    x = f[:, c]
    return {
        "second_order": [x**2], "third_order": [x**3], "odd_quadratic": [x * np.abs(x)],
        "scale_asymmetry": [np.abs(x)],
        "cross_coupling": [f[:, 0] * f[:, 1], f[:, 1] * f[:, 2], f[:, 0] * f[:, 2]],
    }  # fmt: skip


def gyro_terms(w: np.ndarray, f: np.ndarray | None, c: int) -> dict[str, list[np.ndarray]]:
    x = w[:, c] / max(np.abs(w).max(), 1e-9)
    out = {"rate_nonlinearity": [x**3, x * np.abs(x)], "scale_asymmetry": [np.abs(x)]}
    out["cross_axis_rate"] = [w[:, 0] * w[:, 1], w[:, 1] * w[:, 2], w[:, 0] * w[:, 2]]
    if f is not None:
        out["g_sensitivity"] = [f]
        out["g2_sensitivity"] = [
            np.stack([f[:, i] * f[:, j] for i in range(3) for j in range(i + 1)], 1)
        ]
    return out


def invariant(output: np.ndarray, x: np.ndarray, degree: int, gravity: float) -> np.ndarray:
    """Specific force (n, 3) from the usual |a| = g calibration by Gauss-Newton steps."""
    powers = np.stack([x**k for k in range(degree + 1)], 1)
    bias, matrix = np.zeros((degree + 1, 3)), np.zeros((degree + 1, 3, 3))
    rows, cols = np.tril_indices(3)
    force = output
    for _ in range(5):
        size = np.linalg.norm(force, axis=1)
        up = force / size[:, None]
        by_bias = np.einsum("nk,nc->nkc", powers, up).reshape(len(x), -1)
        by_matrix = np.einsum("nk,nm->nkm", powers, up[:, rows] * force[:, cols]).reshape(
            len(x), -1
        )
        step = lstsq(np.concatenate([by_bias, by_matrix], 1), size - gravity, cond=1e-9)[0]
        bias += step[: bias.size].reshape(bias.shape)
        matrix[:, rows, cols] += step[bias.size :].reshape(degree + 1, -1)
        full = np.eye(3) + np.einsum("nk,kij->nij", powers, matrix)
        force = np.linalg.solve(full, (output - powers @ bias)[..., None])[..., 0]
    return force


@dataclass
class Means:
    """Block means of one triad's campaign; `spread` says how each channel enters a residual row."""

    y: np.ndarray
    reading: np.ndarray
    force: np.ndarray | None  # g
    spread: np.ndarray  # (rows, 3)
    drivers: dict[str, np.ndarray]


def means(settings: dict, frame: pl.DataFrame, triad: str, kind: str, degree: int) -> Means:
    """Residual rows of one triad after its references, or after the |a| = g calibration."""
    gravity = settings["site"]["gravity"]
    blocks = segments(frame, rests_only=triad == "accel" or kind == "static")
    mean = lambda x: np.array([x[b].mean(axis=0) for b in blocks])
    optional = lambda prefix: None if (x := three(frame, prefix)) is None else mean(x)
    output, reference = optional(triad), optional(f"reference_{triad}")
    assert output is not None
    planned, felt = optional("reference_accel"), optional("accel")
    force = planned if planned is not None else felt
    force = None if force is None else force / gravity
    d = drivers(frame, blocks, degree)
    if kind == "invariant":
        reading = invariant(output, d["scaled"], degree, gravity)
        size = np.linalg.norm(reading, axis=1)
        return Means(size - gravity, reading, reading / gravity, reading / size[:, None], d)
    against = reference if reference is not None else output.mean(axis=0) * np.ones_like(output)
    spread = np.kron(np.eye(3), np.ones((len(blocks), 1)))
    reading = reference if reference is not None else output
    return Means((output - against).T.ravel(), reading, force, spread, d)


def regression(settings: dict, frame: pl.DataFrame, triad: str) -> Regression:
    """Calibration columns and every column the naive methods know."""
    model = settings["model"]
    kind, degree = model[f"{triad}_estimator"], model.get("temperature_degree", 0)
    m = means(settings, frame, triad, kind, degree)
    n, force = len(m.reading), m.force
    tile = (lambda x: x) if kind == "invariant" else (lambda x: np.concatenate([x] * 3))
    powers = [m.drivers["scaled"] ** k for k in range(degree + 1)]
    base, terms = [], []
    for c in range(3):
        inputs = [np.ones(n)]
        if kind != "static":
            inputs += [m.reading[:, j] for j in range(c + 1 if kind == "invariant" else 3)]
        if triad == "gyro" and model.get("g_sensitivity") and force is not None:
            inputs += list(force.T)
        base += [m.spread[:, c] * tile(p * x) for p in powers for x in inputs]
        own = gyro_terms(m.reading, force, c) if triad == "gyro" else {}
        if triad == "accel" and force is not None:
            own = accel_terms(force, c)
        for name, grid in {**common_terms(m.drivers), **own}.items():
            for column in grid:
                wide = column.reshape(n, -1)
                terms.append((name, c, m.spread[:, [c]] * np.stack([tile(x) for x in wide.T], 1)))
    return Regression(triad, m.y, np.stack(base, 1), terms)


def fitted(columns: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, int]:
    """Least-squares residual and rank."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    x, _, rank, _ = lstsq(columns / scale, y, cond=1e-9)
    return y - (columns / scale) @ x, int(rank)


def best_term(r: Regression, columns: np.ndarray) -> tuple[float, int, float]:
    """Smallest BIC change and p-value (F test, independent rows) over all terms; index of the best."""
    e, rank = fitted(columns, r.y)
    n, rss = len(r.y), float(e @ e)
    best = (np.inf, -1, 1.0)
    for k, (_, _, column) in enumerate(r.terms):
        e1, rank1 = fitted(np.concatenate([columns, column], 1), r.y)
        q = rank1 - rank
        if q <= 0:
            continue
        rss1 = float(e1 @ e1)
        bic = n * np.log(rss1 / rss) + q * np.log(n)
        f = (rss - rss1) / q / (rss1 / (n - rank1))
        if bic < best[0]:
            best = (bic, k, float(stats.f.sf(f, q, n - rank1)))
    return best


def ols(r: Regression) -> list[tuple[str, int, float]]:
    """The one best term, if its F test passes 5 % shared over all terms."""
    bic, k, p = best_term(r, r.base)
    return [(r.terms[k][0], r.terms[k][1], -bic)] if p * len(r.terms) < 0.05 else []


def stepwise(r: Regression) -> list[tuple[str, int, float]]:
    """Forward selection while BIC falls, at most six terms."""
    columns, found = r.base, []
    for _ in range(6):
        bic, k, _ = best_term(r, columns)
        if bic >= 0:
            break
        found.append((r.terms[k][0], r.terms[k][1], -bic))
        columns = np.concatenate([columns, r.terms[k][2]], 1)
    return found


def lasso(r: Regression) -> list[tuple[str, int, float]]:
    """Coordinate descent on residuals, penalty by BIC along the path; terms in order of size."""
    q, _ = np.linalg.qr(r.base / np.maximum(np.linalg.norm(r.base, axis=0), 1e-300))
    wide = np.concatenate([t[2] for t in r.terms], 1)
    owner = np.repeat(np.arange(len(r.terms)), [t[2].shape[1] for t in r.terms])
    wide = wide / np.maximum(np.linalg.norm(wide, axis=0), 1e-300)
    wide = wide - q @ (q.T @ wide)
    size = np.linalg.norm(wide, axis=0)
    keep = size > 1e-3
    wide, owner = wide[:, keep] / size[keep], owner[keep]
    y = r.y - q @ (q.T @ r.y)
    gram, xy, n = wide.T @ wide, wide.T @ y, len(y)
    b, best = np.zeros(len(xy)), (n * np.log(y @ y / n), np.zeros(len(xy)))
    for level in np.abs(xy).max() * np.geomspace(1.0, 0.02, 25):
        for _ in range(60):
            before = b.copy()
            for j in range(len(b)):
                z = xy[j] - gram[j] @ b + b[j]
                b[j] = np.sign(z) * max(abs(z) - level, 0.0)
            if np.abs(b - before).max() < 1e-4 * level:
                break
        rss = float(y @ y - 2 * b @ xy + b @ gram @ b)
        bic = n * np.log(max(rss, 1e-300) / n) + np.count_nonzero(b) * np.log(n)
        if bic < best[0]:
            best = (bic, b.copy())
    found: dict[tuple[str, int], float] = {}
    for j in np.flatnonzero(best[1]):
        name, channel, _ = r.terms[owner[j]]
        found[name, channel] = max(found.get((name, channel), 0.0), abs(float(best[1][j])))
    return sorted(((n, c, s) for (n, c), s in found.items()), key=lambda t: -t[2])


METHODS: dict[str, Callable[[Regression], list]] = {
    "ols": ols,
    "stepwise": stepwise,
    "lasso": lasso,
}


def diagnose(folder: Path, method: str) -> dict:
    """The method's `diagnosis.json` for one campaign."""
    settings, frame = read(folder)
    effects = []
    for triad in ("accel", "gyro"):
        if f"{triad}_estimator" in settings["model"]:
            r = regression(settings, frame, triad)
            scale = float(np.std(fitted(r.base, r.y)[0])) if method == "lasso" else 1.0
            for name, c, strength in METHODS[method](r):
                effects.append(
                    {"name": name, "channels": [f"{triad}_{'xyz'[c]}"], "alternatives": [],
                     "evidence": {"score": strength / scale}}
                )  # fmt: skip
    effects.sort(key=lambda e: -e["evidence"]["score"])
    verdict = "missing-physics" if effects else "consistent"
    return {"schema": "inertiax.diagnosis/1", "verdict": verdict, "effects": effects}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--method", choices=list(METHODS), required=True)
    args = parser.parse_args()
    for folder in sorted(p for p in args.cases.glob("case-*") if p.is_dir()):
        out = args.output / folder.name
        if (out / "run.json").exists():
            continue
        out.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        (out / "diagnosis.json").write_text(json.dumps(diagnose(folder, args.method)) + "\n")
        run = {"status": 0, "seconds": round(time.perf_counter() - start, 2), "stderr": ""}
        (out / "run.json").write_text(json.dumps(run) + "\n")


if __name__ == "__main__":
    main()
