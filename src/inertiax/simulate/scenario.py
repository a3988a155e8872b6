"""Scenario files: a campaign to simulate, in TOML, and the folder that it becomes.

The schema below is strict: an unknown key or a wrong value is an error that names file and key and
says what would be right. `docs/reference/simulator.md` shows a file; every key has a default.
"""

import json
import math
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import jax
import msgspec
import numpy as np

from ..data.formats.columns import nearest
from .bench import Readout
from .chamber import Chamber, DRIFTS, PAPER_CHANGES, PAPER_TEMPERATURES
from .motion import turns_about_three_axes
from .plan import PAPER_GRAVITY, PAPER_LATITUDE, Plan
from .programme import ORDERS, Programme, programme_from_angles, PROGRAMMES, reordered
from .triad import Device, draw_accelerometers, draw_gyros, Noise, typical_noise


ARCSEC = math.pi / 180.0 / 3600.0

_COLUMNS = (
    "device",
    "experiment",
    "position",
    "temperature",
    "reference_accel",
    "reference_gyro",
)


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table in which an unknown key is an error."""


class PlanTable(_Strict, frozen=True):
    """What the station is told to do."""

    programme: str = "18"  # a name in PROGRAMMES
    positions: tuple[tuple[float, float], ...] | None = None  # deg, outer and inner, instead of it
    order: str = "given"  # given | reversed | shuffled
    temperatures: tuple[float, ...] = PAPER_TEMPERATURES  # °C, one experiment each
    drift: str = "centred"  # a name in DRIFTS
    change: float | tuple[float, ...] = PAPER_CHANGES[0]  # °C within an experiment, or within each
    dwell_time: float = 60.0  # s at each position
    slew_time: float = 10.0  # s between positions
    soak_time: float = 7200.0  # s between experiments
    turn_rate: float | tuple[float, ...] = (
        0.0  # deg/s of turns both ways about three axes; 0 = none
    )
    turn_revolutions: int = 1


class SiteTable(_Strict, frozen=True):
    """The test place."""

    gravity: float = PAPER_GRAVITY  # m/s²
    latitude: float = round(math.degrees(PAPER_LATITUDE), 9)  # deg


class DeviceTable(_Strict, frozen=True):
    """The devices, drawn at random around a grade's figures."""

    count: int = 1
    seed: int = 0
    grade: Literal["navigation", "tactical", "consumer"] = "navigation"
    triads: tuple[Literal["accel", "gyro"], ...] = ("accel",)
    degree: int = 6  # of the true curves
    ripple: float = 0.0  # what no polynomial represents, relative to the parameter's swing
    lag: float = 0.0  # s, of the sensing elements behind the probe


class RecordingTable(_Strict, frozen=True):
    """What is logged. Noise that is not given is the grade's."""

    rate: float = 10.0  # Hz
    seed: int = 0
    noise: bool = True  # false: none at all
    accel_noise: float | None = None  # m/s²/√Hz
    gyro_noise: float | None = None  # rad/s/√Hz
    probe_noise: float = 0.0  # °C, of one reading
    accel_step: float = 0.0  # m/s², rounding
    gyro_step: float = 0.0  # rad/s
    temperature_step: float = 0.0  # °C
    columns: tuple[str, ...] = _COLUMNS


class RigTable(_Strict, frozen=True):
    """The station's errors, which the campaign states as well."""

    position_uncertainty: float = 0.0  # arcsec, 1 sigma of each axis at each positioning


class ModelTable(_Strict, frozen=True):
    """The model to fit, handed on to `campaign.toml`."""

    accel_estimator: Literal["invariant", "reference", "static"] | None = None
    gyro_estimator: Literal["reference", "gravity", "static"] | None = None
    g_sensitivity: bool | None = None
    lever_arms: bool | None = (
        None  # the simulated case turns about its sensors: their truth is zero
    )
    temperature_degree: int | None = None


class Scenario(_Strict, frozen=True):
    """A campaign to simulate; see `load_scenario` and `write_campaign`."""

    plan: PlanTable = PlanTable()
    site: SiteTable = SiteTable()
    device: DeviceTable = DeviceTable()
    recording: RecordingTable = RecordingTable()
    rig: RigTable = RigTable()
    model: ModelTable = ModelTable()


def _paper(number: int) -> Scenario:
    return Scenario(
        plan=PlanTable(change=PAPER_CHANGES[number - 1]),
        recording=RecordingTable(seed=number),
        model=ModelTable(accel_estimator="invariant", temperature_degree=6),
    )


# Scenarios that need no file. The paper's sets and its check are of the same device.
SCENARIOS = {
    "paper-set-1": _paper(1),
    "paper-set-2": _paper(2),
    "paper-set-3": _paper(3),
    "paper-check": Scenario(
        plan=PlanTable(
            programme="8",
            temperatures=(20.0,),
            drift="one-sided",
            change=10.0,
            dwell_time=27.0,
            slew_time=12.0,
        ),
        recording=RecordingTable(seed=4),
    ),
    "gyro-table": Scenario(
        plan=PlanTable(change=4.0, turn_rate=30.0),
        device=DeviceTable(triads=("accel", "gyro")),
        recording=RecordingTable(seed=5),
        model=ModelTable(g_sensitivity=True),
    ),
}


def load_scenario(path: Path | str) -> Scenario:
    """The scenario in a TOML file, or one of `SCENARIOS` by name; checked.

    Raises `ValueError` in one line with file and key, what was found and what would be right.
    """
    file = Path(path)
    if not file.exists():
        if str(path) in SCENARIOS:
            return SCENARIOS[str(path)]
        raise ValueError(
            f"{path}: does not exist; a scenario file or one of {', '.join(SCENARIOS)} is needed."
        )
    try:
        raw = tomllib.loads(file.read_text("utf-8-sig"))
    except IsADirectoryError:
        raise ValueError(f"{path}: is a folder; a scenario file (TOML) is needed.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML: {error}.") from None
    try:
        _check_keys(raw)
        scenario = msgspec.convert(raw, Scenario)
        check_scenario(scenario)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$.")
        table, _, key = place.rstrip("`").partition(".")
        raise ValueError(f"{path}: [{table}] {key}: {said.replace('`', '')}.") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return scenario


def _check_keys(raw: dict) -> None:
    """Unknown keys, before msgspec finds them, so that the message can offer the right one."""
    tables = {f.name: f.type for f in msgspec.structs.fields(Scenario)}
    for name, values in raw.items():
        if name not in tables:
            raise ValueError(
                f"unknown table [{name}]; {nearest(name, tables)}known are {', '.join(tables)}."
            )
        if not isinstance(values, dict):
            raise ValueError(f"[{name}] must be a table; found {values!r}.")
        known = [f.name for f in msgspec.structs.fields(tables[name])]
        for key in values:
            if key not in known:
                raise ValueError(
                    f"[{name}] unknown key '{key}'; {nearest(key, known)}known are "
                    f"{', '.join(known)}."
                )


def check_scenario(scenario: Scenario) -> None:
    """Values that no station or device has; raises `ValueError` naming the key."""
    plan, device, recording = scenario.plan, scenario.device, scenario.recording
    _one_of("[plan] programme", plan.programme, PROGRAMMES)
    _one_of("[plan] order", plan.order, ORDERS)
    _one_of("[plan] drift", plan.drift, DRIFTS)
    for column in recording.columns:
        _one_of("[recording] columns", column, _COLUMNS)
    for key, values in (
        ("[plan] temperatures", plan.temperatures),
        ("[device] triads", device.triads),
    ):
        if not values:
            raise ValueError(f"{key} is empty; at least one is needed.")
    if plan.positions is not None and not plan.positions:
        raise ValueError("[plan] positions is empty; at least one pair of angles is needed.")
    if not all(math.isfinite(t) for t in (*plan.temperatures, *_each(plan.change))):
        raise ValueError("[plan] temperatures and change must be finite, in °C.")
    if isinstance(plan.change, tuple) and len(plan.change) != len(plan.temperatures):
        raise ValueError(
            f"[plan] change has {len(plan.change)} values for {len(plan.temperatures)} temperatures; one each, or "
            "one number for all, is needed."
        )
    above = [
        ("[plan] dwell_time", plan.dwell_time, "s"),
        ("[plan] slew_time", plan.slew_time, "s"),
        ("[plan] turn_revolutions", plan.turn_revolutions, "whole turns"),
        ("[device] count", device.count, "devices"),
        ("[recording] rate", recording.rate, "Hz"),
    ]
    for key, value, unit in above:
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{key} = {value:g} must be above 0 {unit}.")
    _check_size(scenario)
    for key, value in _not_negative(scenario):
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{key} = {value:g} must be 0 or more.")
    if not 9.7 <= scenario.site.gravity <= 9.9:
        raise ValueError(
            f"[site] gravity = {scenario.site.gravity:g} is not on Earth; 9.7 to 9.9 m/s² is needed."
        )
    if not -90 <= scenario.site.latitude <= 90:
        raise ValueError(
            f"[site] latitude = {scenario.site.latitude:g} must be within -90 to 90 degrees."
        )


def _check_size(scenario: Scenario) -> None:
    """A scenario that no disk holds is a slip of the pen."""
    plan, device, recording = scenario.plan, scenario.device, scenario.recording
    positions = plan.positions or PROGRAMMES[plan.programme].angles
    seconds = len(plan.temperatures) * len(positions) * (plan.dwell_time + plan.slew_time)
    samples = seconds * recording.rate * device.count
    if samples > _MOST_SAMPLES:
        raise ValueError(
            f"[recording] rate = {recording.rate:g} Hz for {device.count} device(s) and {seconds:g} s at "
            f"positions makes {samples:.2g} samples; {_MOST_SAMPLES:.0e} or fewer are simulated."
        )
    for key, value, most in (
        ("[device] degree", device.degree, 12),
        ("[device] seed", device.seed, 2**32 - 1),
        ("[recording] seed", recording.seed, 2**32 - 1),
    ):
        if value > most:
            raise ValueError(f"{key} = {value} must be at most {most}.")


_MOST_SAMPLES = 1e9


def _not_negative(scenario: Scenario) -> list[tuple[str, float | int]]:
    plan, device, recording = scenario.plan, scenario.device, scenario.recording
    listed: list[tuple[str, float | int]] = [
        ("[plan] soak_time", plan.soak_time),
        *(("[plan] turn_rate", rate) for rate in _each(plan.turn_rate)),
        ("[device] degree", device.degree),
        ("[device] seed", device.seed),
        ("[device] ripple", device.ripple),
        ("[device] lag", device.lag),
        ("[rig] position_uncertainty", scenario.rig.position_uncertainty),
    ]
    keys = ("seed", "accel_noise", "gyro_noise", "probe_noise", "accel_step", "gyro_step")
    for key in (*keys, "temperature_step"):
        value = getattr(recording, key)
        if value is not None:
            listed.append((f"[recording] {key}", value))
    return listed


def _one_of(key: str, found: str, choices: Iterable[str]) -> None:
    names = list(choices)
    if found not in names:
        raise ValueError(
            f"{key}: {nearest(found, names)}it must be one of {', '.join(names)}; found {found!r}."
        )


def _each(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def scenario_toml(scenario: Scenario) -> str:
    """The text of a scenario file; `load_scenario` reads the same scenario from it."""
    lines = []
    for table, values in msgspec.to_builtins(scenario).items():
        said = {key: value for key, value in values.items() if value is not None}
        # JSON's text, numbers, lists and truth values are TOML's.
        lines += [f"[{table}]", *(f"{k} = {json.dumps(v)}" for k, v in said.items()), ""]
    return "\n".join(lines)


# --- from tables to the bench ----------------------------------------------------------------


def plan_of(scenario: Scenario) -> Plan:
    """What the scenario tells the station to do."""
    said = scenario.plan
    rates = [math.radians(rate) for rate in _each(said.turn_rate) if rate]
    turns = [turns_about_three_axes(rate, revolutions=said.turn_revolutions) for rate in rates]
    change = np.array(said.change) if isinstance(said.change, tuple) else said.change
    return Plan(
        reordered(_programme(said), said.order, seed=scenario.recording.seed),
        Chamber(np.array(said.temperatures, float), change, said.drift),
        gravity=scenario.site.gravity,
        latitude=math.radians(scenario.site.latitude),
        dwell_time=said.dwell_time,
        slew_time=said.slew_time,
        soak_time=said.soak_time,
        turns=tuple(turn for each in turns for turn in each),
        position_error=scenario.rig.position_uncertainty * ARCSEC,
    )


def _programme(said: PlanTable) -> Programme:
    if said.positions is None:
        return PROGRAMMES[said.programme]
    return programme_from_angles("given", np.array(said.positions, float))


def devices_of(scenario: Scenario) -> dict[str, Device]:
    """The scenario's devices by serial number; device n is the same whatever their count."""
    said = scenario.device
    found = {}
    for number in range(said.count):
        key = jax.random.fold_in(jax.random.key(said.seed), number)
        accel, gyro = jax.random.split(key)
        figures = {"grade": said.grade, "degree": said.degree, "ripple": said.ripple}
        found[f"SIM{number + 1:04d}"] = Device(
            accel=draw_accelerometers(accel, **figures) if "accel" in said.triads else None,
            gyro=draw_gyros(gyro, **figures) if "gyro" in said.triads else None,
            lag=said.lag,
        )
    return found


def noise_of(scenario: Scenario) -> Noise:
    """The devices' noise: what the scenario gives, and the grade's where it is silent."""
    said = scenario.recording
    typical = typical_noise(scenario.device.grade)
    return Noise(
        accel=typical.accel if said.accel_noise is None else said.accel_noise,
        gyro=typical.gyro if said.gyro_noise is None else said.gyro_noise,
        probe=said.probe_noise,
    )


def readout_of(scenario: Scenario) -> Readout:
    """The steps to which the outputs are rounded."""
    said = scenario.recording
    return Readout(said.accel_step, said.gyro_step, said.temperature_step)
