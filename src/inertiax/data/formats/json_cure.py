"""The command that writes the samples in a JSON file as a table, wherever in the file they stand."""

import json
import re
from pathlib import Path
from typing import Any, NamedTuple


_MOST_BYTES = 1 << 28  # that are parsed to find a cure; a greater file is told how in general
_DEEPEST = 6  # levels of groups
_PLAIN = re.compile(r"[\w .:()/-]+")  # what needs no care in a command, between double quotes
_SENSORS = re.compile(r"acc|gyr|omega|imu", re.IGNORECASE)
_WHERE = "write its samples as text, a row each and a column for each output"


class _Samples(NamedTuple):
    keys: tuple[str, ...]  # the way to them
    flat: bool  # numbers alone: a table as it is
    of_sensors: bool
    rows: int


def cure(path: Path, *, lines: bool) -> str:
    """What to do with a JSON file; `lines` says that it is one document a line.

    Samples are a list of records, or lists of one length side by side. Records within records become columns of both
    names: `{"acc": [1, 2, 3]}` is `acc_0`, `acc_1`, `acc_2`.
    """
    name = repr(path.name)
    if lines:
        return _command(f"polars.read_ndjson({name})")
    document = f"json.load(open({name}))"
    if path.stat().st_size > _MOST_BYTES:
        return _command(f"polars.DataFrame({document})")
    try:
        found = list(_samples(json.loads(path.read_bytes()), ()))
    except ValueError:  # cut off, or not quite JSON: the command's own words say where
        return _command(f"polars.DataFrame({document})")
    if not found:
        return _WHERE
    best = max(found, key=lambda s: (s.of_sensors, s.rows))
    rows = document + "".join(f"[{key!r}]" for key in best.keys)
    if best.flat:
        return _command(f"polars.DataFrame({rows})")
    parts = "v.items() if type(v) is dict else enumerate(v) if type(v) is list else [('', v)]"
    record = f"{{f'{{k}}_{{i}}'.rstrip('_'): x for k, v in r.items() for i, x in ({parts})}}"
    return _command(f"polars.DataFrame([{record} for r in {rows}])")


def _command(table: str) -> str:
    return f"write its columns as text: python -c \"import json, polars; {table}.write_csv('log.csv')\""


def _samples(node: Any, keys: tuple[str, ...]):
    """Every table in a document, with the way to it."""
    if len(keys) > _DEEPEST or not all(map(_PLAIN.fullmatch, keys)):
        return
    if isinstance(node, list):
        if node and all(isinstance(r, dict) and r for r in node):
            flat = all(_is_scalar(v) for r in node for v in r.values())
            if flat or all(_is_part(v) for r in node for v in r.values()):
                yield _Samples(keys, flat, _of_sensors((*keys, *node[0])), len(node))
    elif isinstance(node, dict):
        columns = [v for v in node.values() if isinstance(v, list) and all(map(_is_scalar, v))]
        lengths = {len(v) for v in columns}
        if len(columns) == len(node) and len(lengths) == 1 and max(lengths) > 0:
            yield _Samples(keys, True, _of_sensors((*keys, *node)), max(lengths))
        for key, value in node.items():
            yield from _samples(value, (*keys, key))


def _of_sensors(words: tuple[str, ...]) -> bool:
    return any(map(_SENSORS.search, words))


def _is_scalar(value: Any) -> bool:
    return not isinstance(value, dict | list)


def _is_part(value: Any) -> bool:
    """Whether a field of a record is a value, or a few of them."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return all(map(_is_scalar, inner))
