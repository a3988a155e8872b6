"""Events as they go out: one mapping for each, one line of JSON (docs/live.md)."""

from .estimate import Estimate
from .next_position import NextPosition
from .rest_ledger import Rest
from .row_store import RowStore


Event = dict[str, object]


def rest_event(rest: Rest, store: RowStore) -> Event:
    """A rest with its verdict; the mean is that of all of it where nothing of it is used."""
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
        "left_out": [
            {"kind": d.kind, "start": d.start, "end": d.end}
            for d in rest.disturbances
            if d.left_out
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


def progress_event(found: Estimate) -> Event:
    """What is known so far, against the target."""
    return {
        "event": "progress",
        "worst": found.worst,
        "ratio": found.ratio,
        "parameters": found.parameters(),
    }


def next_event(position: NextPosition, *, provisional: bool = False) -> Event:
    """Where to turn; `provisional` while the device still rests."""
    return {
        "event": "next",
        "up": list(position.up),
        "statement": position.statement,
        "gain": position.gain,
        "temperature": None,
        "rate": None,
        "provisional": provisional,
    }
