"""A scenario to a campaign folder: `campaign.toml`, Parquet recordings, `truth.json`."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import jax
import msgspec
import numpy as np
import polars as pl

from ..data.recording import Recording
from .bench import simulate_recordings
from .scenario import check_scenario, devices_of, noise_of, plan_of, readout_of, Scenario
from .truth import truth_to_json


def write_campaign(
    scenario: Scenario, folder: Path | str, *, progress: Callable[[str], None] | None = None
) -> Path:
    """Simulate a scenario and write the campaign; the folder appears only when it is complete.

    One Parquet file per device and experiment, with the contract's columns in SI; `truth.json` has
    the true parameters, basis and units (`read_truth` reads it). **Returns** the folder.

    Raises `ValueError` where the folder exists and is not empty, or the scenario makes no sense.
    """
    check_scenario(scenario)
    target = Path(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ValueError(f"{target}: exists and is not an empty folder; name a new one.")
    target.parent.mkdir(parents=True, exist_ok=True)
    # Written beside and renamed, so that a run cut short leaves no half campaign behind.
    beside = target.parent / f".{target.name}.{os.getpid()}.partial"
    beside.mkdir()
    try:
        _write(scenario, beside, progress or (lambda _: None))
        if target.exists():
            target.rmdir()
        beside.rename(target)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return target


def _write(scenario: Scenario, folder: Path, progress: Callable[[str], None]) -> None:
    plan, devices = plan_of(scenario), devices_of(scenario)
    key = jax.random.key(scenario.recording.seed)
    for number, (serial, device) in enumerate(devices.items()):
        progress(f"device {serial}, {number + 1} of {len(devices)}")
        recordings, _ = simulate_recordings(
            jax.random.fold_in(key, number) if scenario.recording.noise else None,
            plan,
            device,
            noise=noise_of(scenario),
            readout=readout_of(scenario),
            sample_rate=scenario.recording.rate,
            serial=serial,
        )
        for experiment, recording in enumerate(recordings):
            table = _table(recording, scenario.recording.columns)
            table.write_parquet(folder / f"{serial}-{experiment:02d}.parquet")
    said = msgspec.to_builtins(scenario)
    truth = truth_to_json(devices, said, scenario.site.gravity)
    (folder / "truth.json").write_text(truth, "utf-8")
    (folder / "campaign.toml").write_text(_campaign_toml(scenario), "utf-8")


def _table(recording: Recording, columns: tuple[str, ...]) -> pl.DataFrame:
    """The contract's columns that were measured or asked for."""
    data: dict[str, np.ndarray | pl.Series] = {"time": recording.time}
    if "device" in columns:
        data["device"] = pl.repeat(recording.device, recording.num_samples, eager=True)
    for name in ("experiment", "position"):
        values = getattr(recording, name)
        if name in columns and values is not None:
            data[name] = values.astype(np.int32)
    if "temperature" in columns and recording.temperature is not None:
        data["temperature"] = recording.temperature[:, 0]
    for triad in ("accel", "gyro"):
        if getattr(recording, triad) is None:
            continue
        for name in (triad, f"reference_{triad}"):
            values = getattr(recording, name)
            if values is not None and (name == triad or name in columns):
                data |= {f"{name}_{axis}": values[:, i] for i, axis in enumerate("xyz")}
    return pl.DataFrame(data)


def _campaign_toml(scenario: Scenario) -> str:
    lines = [
        "[site]",
        f"gravity = {scenario.site.gravity!r}",
        f"latitude = {scenario.site.latitude!r}",
        "",
        "[recordings]",
        'files = ["*.parquet"]',
        "",
        "[device]",
        f"grade = {json.dumps(scenario.device.grade)}",
    ]
    if scenario.rig.position_uncertainty > 0:
        lines += ["", "[rig]", f"position_uncertainty = {scenario.rig.position_uncertainty!r}"]
    model = {k: v for k, v in msgspec.structs.asdict(scenario.model).items() if v is not None}
    if model:
        # JSON's text, numbers and truth values are TOML's.
        lines += ["", "[model]", *(f"{k} = {json.dumps(v)}" for k, v in model.items())]
    return "\n".join(lines) + "\n"
