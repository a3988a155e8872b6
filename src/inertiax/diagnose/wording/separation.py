"""Sets of names out of `diagnosis.json`, and the run that parts one as text, JSON, checklist and scenario."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from ...data.json_documents import decode
from ...effects import CATALOGUE
from ...simulate.scenario import scenario_toml
from ...storage.whole_files import write_atomically
from ..plan.separate import NameSet, Separation
from ..result import SCHEMA


MOST_ODDS = 1e6  # said as "more than": no model is right beyond that
_KNOWN = {e.name: e for e in CATALOGUE}


class _Effect(msgspec.Struct):
    name: str
    channels: list[str]
    alternatives: list[str]


class _Document(msgspec.Struct):
    schema: str
    effects: list[_Effect]
    campaign: str | None = None
    device: str = ""


@dataclass(frozen=True)
class Stated:
    """What a diagnosis says of names that it could not part."""

    entries: tuple[NameSet, ...]  # all that was named
    campaign: Path | None  # that was diagnosed
    device: str

    @property
    def sets(self) -> tuple[NameSet, ...]:
        """Those of more than one name."""
        return tuple(one for one in self.entries if len(one.names) > 1)

    def beside(self, one: NameSet) -> tuple[NameSet, ...]:
        """What else was named."""
        return tuple(other for other in self.entries if other is not one)


def read_sets(path: Path) -> Stated:
    """The sets of a diagnosis, its file or the folder that holds it.

    Raises `ValueError`, one line, where it is none, names unknown effects or channels, or leaves nothing to part.
    """
    file = path / "diagnosis.json" if path.is_dir() else path
    try:
        found = decode(file.read_bytes(), _Document, str(file), "a diagnosis", SCHEMA)
    except OSError as error:
        raise ValueError(f"{file}: cannot be read ({error.strerror}).") from None
    made = [
        NameSet((e.name, *dict.fromkeys(e.alternatives)), tuple(e.channels)) for e in found.effects
    ]
    for one in made:
        _require_known(one, file)
    if all(len(one.names) == 1 for one in made):
        raise ValueError(f"{file}: no effect has alternatives, so there is nothing to separate.")
    campaign = (
        None if found.campaign is None else Path(os.path.normpath(file.parent / found.campaign))
    )
    return Stated(tuple(made), campaign, found.device)


def _require_known(one: NameSet, file: Path) -> None:
    channels = [f"{t}_{axis}" for t in ("accel", "gyro") for axis in "xyz"]
    for name in one.names:
        if name not in _KNOWN:
            raise ValueError(f"{file}: {name!r} is no effect of the catalogue.")
    if not one.channels or any(c not in channels for c in one.channels):
        raise ValueError(f"{file}: channels {list(one.channels)} are not of {', '.join(channels)}.")


def odds(log_bayes_factor: float) -> float:
    """Odds of a logarithm of a Bayes factor, none beyond `MOST_ODDS`."""
    return float(min(np.exp(min(log_bayes_factor, 50.0)), MOST_ODDS))


def summary(found: Separation) -> tuple[str, ...]:
    """What to do and what to expect, without the odds of each pair."""
    said = lines(found)
    first = 1 + len(found.best.run.checklist())
    values = [odds(value) for _, _, value in found.best.pairs]
    least, most = min(values), max(values)
    over = "more than " if most >= MOST_ODDS else ""
    expected = (
        f"  expected odds of the {len(values)} pairs of names: {least:.3g} to {over}{most:.3g} to 1; "
        "`inertiax design --separate` says each"
    )
    return (*said[:first], expected, *said[first + len(values) :])


def lines(found: Separation) -> tuple[str, ...]:
    """What to do, why, and what to expect."""
    best = found.best
    made = [
        f"{', '.join(found.names.names)} on {', '.join(found.names.channels)}: {best.run.name}, "
        f"{best.run.minutes:.0f} min"
    ]
    made += [f"  {k}. {step}" for k, step in enumerate(best.run.checklist(), start=1)]
    for i, j, value in best.pairs:
        over = "more than " if odds(value) >= MOST_ODDS else ""
        made.append(f"  expected if it is {i}: {over}{odds(value):.3g} to 1 against {j}")
    if not best.enough:
        made.append("  one such run may leave a set; the odds add up over several")
    if found.hopeless:
        said = dict.fromkeys(_KNOWN[n].separating for n in found.hopeless)
        made.append(f"  no run here parts {', '.join(found.hopeless)}: {'; or '.join(said)}")
    return tuple(made)


def document(found: Separation) -> dict:
    """The same for scripts."""
    return {
        "names": list(found.names.names),
        "channels": list(found.names.channels),
        "run": found.best.run.name,
        "minutes": found.best.run.minutes,
        "enough": found.best.enough,
        "checklist": list(found.best.run.checklist()),
        "expected": [
            {"true": i, "rival": j, "log_bayes_factor": value, "odds": odds(value)}
            for i, j, value in found.best.pairs
        ],
        "not_parted": list(found.hopeless),
        "runs": [
            {"run": e.run.name, "minutes": e.run.minutes, "worst_log_bayes_factor": e.worst}
            for e in found.runs
        ],
    }


def documents(found: Sequence[Separation]) -> dict:
    """All sets of a diagnosis, schema `inertiax.separation/1`."""
    return {"schema": "inertiax.separation/1", "sets": [document(one) for one in found]}


def write_separations(found: Sequence[Separation], folder: Path) -> None:
    """Write `separation.json`, and for each set `scenario.toml` and `checklist.md`, numbered from the second on."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(documents(found), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_atomically(folder / "separation.json", text.encode())
    for number, one in enumerate(found, start=1):
        suffix = "" if number == 1 else f"-{number}"
        toml = scenario_toml(one.scenario())
        write_atomically(folder / f"scenario{suffix}.toml", toml.encode())
        write_atomically(folder / f"checklist{suffix}.md", _checklist(one).encode())


def _checklist(found: Separation) -> str:
    head, *rest = lines(found)
    steps = [f"- [ ] {step}" for step in found.best.run.checklist()]
    expected = [x.strip() for x in rest if not x.strip()[0].isdigit()]
    after = "Then diagnose the recordings of the campaign and of this run together."
    return "\n".join([f"# {head}", "", *steps, "", *(f"{x}." for x in expected), "", after, ""])
