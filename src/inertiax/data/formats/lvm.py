"""LabVIEW measurement files (`.lvm`): headers of keys, then rows whose last column is for comments.

**Reference:** National Instruments, Specification for the LabVIEW Measurement File (.lvm).
"""

import re


BEGINS = b"LabVIEW Measurement"
_END = b"***End_of_Header***"
_TIME = "X_Value"
_STEP = re.compile(r"\d+(?:\.\d*)?(?:[eE][+-]?\d{1,2})?")
_COMMA = re.compile(r"^Separator[,\t]Comma", re.MULTILINE)


def is_lvm(text: bytes) -> bool:
    """Whether a text is such a file."""
    return text.startswith(BEGINS)


def as_rows(text: bytes, where: str) -> bytes:
    """The rows under a line of names with their units, without comments; where no time is written with them, the rate
    of Delta_X stands above.

    Raises `ValueError` for a file of several segments, or without any.
    """
    *headers, rows = text.decode("utf-8", "replace").split(_END.decode())
    if not 1 <= len(headers) <= 2:
        raise ValueError(
            f"{where}: a LabVIEW measurement of {max(len(headers) - 1, 0)} segments; one is read: write each into a "
            "file of its own."
        )
    between = "," if _COMMA.search(headers[0]) else "\t"
    keys = {k: v for header in headers for k, v in _keys(header, between).items()}
    body = [line.split(between) for line in rows.splitlines() if line.strip(f"{between} ")]
    if not body:
        raise ValueError(f"{where}: a LabVIEW measurement without a row; one is needed.")
    names = [n.strip() for n in body.pop(0)]
    names = names[: names.index("Comment")] if "Comment" in names else names
    first = 1 if keys.get("X_Columns", ["One"])[0] == "No" else 0  # the column of times is empty
    columns = slice(first, len(names))
    units = iter(keys.get("Y_Unit_Label", []))
    titles = [f"{n} [s]" if n == _TIME else _titled(n, next(units, "")) for n in names[columns]]
    lines = [between.join(titles), *(between.join(r[columns]) for r in body)]
    step = keys.get("Delta_X", [""])[0].replace(",", ".")
    if first and _STEP.fullmatch(step) and float(step) > 0.0:
        lines.insert(0, f"rate{between}{1.0 / float(step):.9g}")
    return "\n".join(lines).encode() + b"\n"


def _titled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _keys(header: str, between: str) -> dict[str, list[str]]:
    """The values of each key of a header."""
    rows = ([f.strip() for f in line.split(between)] for line in header.splitlines())
    return {key: values for key, *values in rows if key and values}
