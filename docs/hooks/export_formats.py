"""The table of other tools' formats, from the registry that `inertiax export` writes by."""

import msgspec
from table_rows import table

from inertiax.exports.registry import FORMATS, loses


def formats() -> str:
    """A row for each format: what it holds, what it loses, its settings, and whether it is read, too."""
    rows = []
    for module in FORMATS:
        settings = ", ".join(f"`{f.name}`" for f in msgspec.structs.fields(module.Settings))
        reads = "yes" if hasattr(module, "read") else "no"
        rows.append(
            (f"`{module.NAME}`", module.TITLE, module.KEEPS, loses(module), settings, reads)
        )
    return table(("format", "file", "keeps", "loses", "settings", "reads"), rows)
