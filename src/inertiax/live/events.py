"""Events as they go out: one mapping for each, one line of JSON (docs/live.md)."""

import numpy as np

from ..calibration.quantities import customary_unit
from .estimate import Estimate, Triad, TRIADS
from .far_target import far_target_in_words
from .next_position import NextPosition
from .rest_ledger import Rest
from .row_store import RowStore
from .target import Target


Event = dict[str, object]
STATE = 0.1  # s of rows whose mean is the device now
NOISE = 1.0  # s of rows at rest that tell the noise of a sample


def start_event(target: Target, hold: float) -> Event:
    """What is asked for."""
    return {
        "event": "start",
        "target": target.text,
        "limits": dict(target.limits),
        "usual_for": target.usual_for,
        "hold": hold,
    }


def done_event(reason: str, rests: int, seconds: float) -> Event:
    """The end."""
    return {"event": "done", "reason": reason, "rests": rests, "seconds": seconds}


def rest_event(rest: Rest, store: RowStore, uncounted: str | None = None) -> Event:
    """A rest with its verdict; the mean is that of all of it where nothing of it is used.

    **Arguments:** `uncounted` is why it does no step of a run, in words.
    """
    accel = rest.accel
    if accel is None:
        recording = store.recording(rest.start, rest.stop, means=True)
        accel = None if recording.accel is None else recording.accel.mean(axis=0)
    return {
        "event": "rest",
        "number": rest.number,
        "start": rest.time[0],
        "end": rest.time[1],
        "mean_accel": None if accel is None else [float(x) for x in accel],
        "accepted": rest.accepted,
        "why": rest.why,
        "held": rest.held,
        "uncounted": uncounted,
        "left_out": [
            {"kind": d.kind, "start": d.start, "end": d.end}
            for d in rest.disturbances
            if d.left_out and not (rest.held and d.kind == "held")
        ],
    }


def problem_event(kind: str, severity: str, statement: str, remedy: str | None = None) -> Event:
    """What cannot be right; `remedy` is TOML for campaign.toml."""
    return {
        "event": "problem",
        "kind": kind,
        "severity": severity,
        "statement": statement,
        "remedy": remedy,
    }


def withdrawn_event(kind: str, statement: str) -> Event:
    """A problem that a later look at more rows does not find."""
    made = problem_event(kind, "note", f"no longer found: {statement}")
    return made | {"withdraws": statement}


def progress_event(found: Estimate) -> Event:
    """What is known so far, against the target."""
    return {
        "event": "progress",
        "worst": found.worst,
        "ratio": found.ratio,
        "lacking": found.lacking,
        "parameters": found.parameters(),
    }


def warming_event(triad: Triad, rests: list[Rest]) -> Event:
    """The biases of a triad follow the temperature: how much, and what to do."""
    assert triad.slopes is not None
    name = triad.names[0]
    factor, unit = customary_unit(name, coarse=True)
    worst = int(np.argmax(np.abs(triad.slopes)))
    seen = [r.temperature for r in rests if r.temperature is not None]
    place, reach = TRIADS[name.partition(".")[0]], f"{min(seen):.1f} to {max(seen):.1f} °C so far"
    return problem_event(
        "temperature",
        "warning",
        f"biases of the {place} follow the temperature ({reach}), {'xyz'[worst]} by "
        f"{factor * triad.slopes[worst]:.2g} {unit} per °C. They are said at the rests' mean; this needs more rests "
        "than one temperature does: let the device warm up before a session.",
    )


def far_target_event(found: Estimate, further: int) -> Event:
    """The target needs so many `further` rests that a person hardly makes them."""
    return problem_event("target", "note", far_target_in_words(found, further))


def next_event(position: NextPosition, *, provisional: bool = False) -> Event:
    """Where to turn; `provisional` while the device still rests."""
    return {
        "event": "next",
        "up": list(position.up),
        "statement": position.statement,
        "gain": position.gain,
        "further": position.further,
        "temperature": position.temperature,
        "rate": position.rate,
        "provisional": provisional,
    }


def state_event(store: RowStore, step: float, *, moving: bool) -> Event | None:
    """The device now: direction of the specific force, turn rate, temperature, and while it rests the samples' noise.

    **Arguments:** `step` is from row to row of the store, s. `None` while there are too few rows.
    """
    rows = max(round(STATE / step), 1)
    if store.count < rows:
        return None
    now = store.recording(store.count - rows, means=True)
    made: Event = {"event": "state", "moving": moving, "time": float(now.time[-1])}
    force = None if now.accel is None else now.accel.mean(axis=0)
    size = 0.0 if force is None else float(np.linalg.norm(force))
    made["up"] = [float(x) for x in force / size] if force is not None and size > 0.0 else None
    made["rate"] = None if now.gyro is None else float(np.linalg.norm(now.gyro.mean(axis=0)))
    probes = now.temperature
    made["temperature"] = None if probes is None else float(probes[:, 0].mean())
    made["noise"] = {} if moving else _noise(store, max(round(NOISE / step), 2))
    return made


def _noise(store: RowStore, rows: int) -> dict[str, float]:
    """Standard deviation of a sample of each triad about its mean, the three axes together, SI."""
    if store.count < rows:
        return {}
    picked = store.recording(store.count - rows)
    triads = {"accel": picked.accel, "gyro": picked.gyro}
    of = lambda x: float(np.sqrt(x.var(axis=0, ddof=1).mean()))
    return {name: of(x) for name, x in triads.items() if x is not None}
