"""The table of other tools' formats, from the registry that `inertiax export` writes by."""

import msgspec

from inertiax.exports.registry import FORMATS


def table() -> str:
    """A row for each format: what it holds, what it loses, its settings, and whether it is read, too."""
    rows = ["| format | file | keeps | loses | settings | reads |", "|---|---|---|---|---|---|"]
    for module in FORMATS:
        settings = ", ".join(f"`{f.name}`" for f in msgspec.structs.fields(module.Settings))
        reads = "yes" if hasattr(module, "read") else "no"
        cells = (f"`{module.NAME}`", module.TITLE, module.KEEPS, module.LOSES, settings, reads)
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)
