"""From a diagnosed device to its record."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from ..calibration.calibration import Calibration
from ..data.inputs import InputFile
from ..data.recording import Campaign
from ..diagnose.result import Diagnosis
from .make_record import EFFECTS, KNOWN, record_of
from .record import EffectRecord, Record


def diagnosis_record(
    found: Diagnosis,
    calibration: Calibration,
    campaign: Campaign,
    folder: Path,
    command: str,
    inputs: Sequence[InputFile],
    *,
    precompensated: bool = False,
) -> Record:
    """The record of a diagnosis, whose `calibration.json` lies in `folder`.

    **Arguments:** `precompensated` where a known calibration was taken away first; the others as of `record_of`.
    """
    assert found.estimate is not None  # `diagnose_campaign` made it
    said = (
        () if found.verdict == "consistent" else (f"Diagnosis, {found.verdict}: {found.summary}",)
    )
    names = [KNOWN] if precompensated else []
    names += [EFFECTS] if calibration.effects else []
    record = record_of(
        found.estimate, campaign, folder, command, inputs,
        calibration=calibration, beside=" and ".join(names) or EFFECTS,
    )  # fmt: skip
    effects = tuple(
        EffectRecord(effect.name, effect.channels, name, p.value, p.std, p.unit)
        for effect in found.effects
        for name, p in effect.parameters
    )
    return msgspec.structs.replace(record, warnings=(*record.warnings, *said), effects=effects)
