"""The magnetometers' line of a draft."""

import numpy as np

from .accel_unit import TriadUnit
from .companions import field_companion
from .mag_unit import field_unit
from .raw_triads import RawTriads
from .toml_text import CHECK, Line


def magnetometers(
    found: RawTriads, named: bool, accel: TriadUnit | None
) -> tuple[list[Line], list[str]]:
    """The magnetometers' line, or a remark that they are left out.

    **Arguments:** `named` says that the columns have names of their own; `accel` is the accelerometers' unit, whose
    scale may tell the chip.

    Raises `ValueError` where there is nothing else in the log.
    """
    log, names = found.log, found.roles.mag
    assert names is not None
    outputs = np.stack([log.numbers[n] for n in names], axis=1)
    words = " ".join(log.hint(n) for n in names)
    told = field_unit(outputs, names, words, field_companion(accel))
    if told is not None:
        value: dict[str, object] = {"names": list(names)} if named else {}
        by = found.roles.mag_by
        why = told.why if by is None else f"{by}; {told.why}"
        value["unit"] = told.unit
        value |= {} if told.scale is None else {"scale": told.scale, "scale_unit": "count per uT"}
        return [Line("mag", value, why, told.certain and by is None)], []
    if found.accel is None and found.gyro is None:
        raise ValueError(
            f"{log.path}: {', '.join(names)} do not tell their unit, for the device was not turned in all "
            "directions; turn it so, away from steel, or write campaign.toml by hand."
        )
    return [], [f"{CHECK} mag: {', '.join(names)} do not tell their unit; they are left out"]
