"""The reference of the files that commands write, from the structures that write and read them."""

import inspect

from declared_fields import field_table

from inertiax.calibration import json_file
from inertiax.calibration.fitted_effects import EffectEntry
from inertiax.data.inputs import InputFile
from inertiax.diagnose import result
from inertiax.diagnose.plan.limits import Detectable
from inertiax.fleet.input_hashes import FleetInputs
from inertiax.fleet.population.population import Outlier, Population, TriadPopulation
from inertiax.model_selection.model_spec import ModelSpec, TriadSpec
from inertiax.plausibility.finding import Finding
from inertiax.protocol import record
from inertiax.reduction.handling import Disturbance


FILES: dict[str, tuple[type, ...]] = {
    "calibration.json": (
        json_file._File,
        json_file._Triad,
        json_file._Accelerometers,
        json_file._Magnetometers,
        json_file._Barometer,
        json_file._Basis,
        EffectEntry,
    ),
    "record.json": (
        record.Record,
        InputFile,
        record.StationRecord,
        record.ConditionsRecord,
        record.TriadRecord,
        record.SourceRecord,
        record.EffectRecord,
    ),
    "The block `model`": (ModelSpec, TriadSpec),
    "diagnosis.json": (
        result.Diagnosis,
        result.Where,
        result.Explanation,
        result.Parameter,
        result.Evidence,
        result.Quality,
        result.Moved,
        Detectable,
        Disturbance,
    ),
    "check --json": (Finding,),
    "inputs.json": (FleetInputs, InputFile),
    "population.json": (Population, TriadPopulation, Outlier),
}
NOTES = {
    "calibration.json": "Schema `inertiax.calibration/1`, of `calibrate`, `diagnose`, `live` and `fleet --device`.",
    "record.json": "Schema `inertiax.record/1`, of `calibrate`, `diagnose` and `live`: what "
    "[`protocol`](../protocol.md) reads beside `calibration.json`.",
    "The block `model`": "The model that was judged, the same in `calibration.json`, `calibrate --json`, "
    "`diagnosis.json`, `design --audit --json` and a fleet's results.",
    "diagnosis.json": "Schema `inertiax.diagnosis/1`. `baseline` and `augmented` stand under `fit`; `residuals` are "
    "for the figures, `estimate` is for `record.json`, and neither is in the file.",
    "check --json": "Schema `inertiax.check/1`: `verdict` (plausible, doubtful, implausible) and `findings`. "
    "The [kinds](plausibility.md#what-is-looked-at) have a page.",
    "inputs.json": "Schema `inertiax.fleet-inputs/1`, of `fleet`: what was read, for "
    "[`protocol`](../protocol.md) of a device.",
    "population.json": "Schema `inertiax.population/1`, of `fleet`: the line, which `--prior` takes.",
}


def page() -> str:
    """A section for each file, a table for each structure in it."""
    parts = []
    for file, classes in FILES.items():
        parts += [f"## {file}", NOTES[file]]
        for cls in classes:
            parts += [f"**{_words(cls)}**", field_table(cls)]
    return "\n\n".join(parts)


def _words(cls: type) -> str:
    return (inspect.getdoc(cls) or cls.__name__).partition("\n")[0]
