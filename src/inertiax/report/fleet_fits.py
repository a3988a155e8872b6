"""How good a fleet's fits are, in sentences: how many, and for what devices are reserved."""

from collections.abc import Sequence

from ..fleet.verdicts import Reserved


NAMED = 10  # devices in a sentence


def fit_sentence(fits: dict[str, int], reserved: Sequence[str] = ()) -> str:
    """How many devices' fits are good, by the rule of `calibrate`; `reserved` are those whose is not."""
    words = {
        "good": "good", "usable": "usable with a reservation", "doubtful": "not to be used yet"
    }  # fmt: skip
    said = ", ".join(f"{fits[v]} {words[v]}" for v in words if fits[v])
    which = f" ({_named(reserved)})" if reserved else ""
    return f"Fit by the rule of `calibrate`: {said}{which}."


def reserved_lines(why: Sequence[Reserved]) -> list[str]:
    """What devices are reserved for, each with how many, and the first of them; the rarest first."""
    return [f"{len(r.devices)} × {r.words.rstrip('.')} ({_named(r.devices)})" for r in why[:NAMED]]


def _named(devices: Sequence[str]) -> str:
    return ", ".join(devices[:NAMED]) + (", …" if len(devices) > NAMED else "")
