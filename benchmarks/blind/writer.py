"""A case as a campaign folder: `campaign.toml` and one Parquet file per session."""

from pathlib import Path

import numpy as np
import polars as pl
from draw import Case


def columns(case: Case) -> pl.DataFrame:
    """The log in canonical columns, SI."""
    plan = case.plan
    data: dict[str, np.ndarray] = {"time": np.round(plan.time, 6)}
    for triad in plan.triads:
        for k, axis in enumerate("xyz"):
            data[f"{triad}_{axis}"] = case.output[triad][:, k]
    data["temperature"] = case.heat.probe
    data["experiment"] = plan.experiment.astype(np.int64)
    data["position"] = plan.position.astype(np.int64)
    for triad in plan.references:
        for k, axis in enumerate("xyz"):
            data[f"reference_{triad}_{axis}"] = case.reference[triad][:, k]
    return pl.DataFrame(data)


def campaign(case: Case) -> str:
    """The text of `campaign.toml`."""
    grade = case.grade
    lines = ["[site]", f"gravity = {case.gravity:.6f}", f"latitude = {case.latitude:.2f}", ""]
    lines += ["[recordings]", 'files = ["*.parquet"]', "", "[rig]"]
    lines += [f"position_uncertainty = {grade.position}", f"rate_uncertainty = {grade.rate}"]
    lines += [f"temperature_uncertainty = {grade.temperature}", "", "[device]"]
    lines += [f'grade = "{case.grade_name}"', "", "[model]"]
    for key in sorted(case.plan.model):
        value = case.plan.model[key]
        text = str(value).lower() if isinstance(value, bool | int) else f'"{value}"'
        lines.append(f"{key} = {text}")
    return "\n".join(lines) + "\n"


def write(case: Case, folder: Path):
    """Write the folder; files are in the order of the sessions."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(campaign(case))
    frame = columns(case)
    for s in np.unique(case.plan.session):
        rows = pl.Series(case.plan.session == s)
        frame.filter(rows).write_parquet(folder / f"recordings-{s}.parquet")
