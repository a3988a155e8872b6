"""A phase for OpenHTF, a test executive: writes the protocol of a device under test and measures its requirements.

OpenHTF is an extra, `pip install 'inertiax[openhtf]'`.

    import openhtf
    from inertiax.protocol.openhtf_phase import protocol_phase

    test = openhtf.Test(calibrate, protocol_phase("results", "protocol", requirements="limits.toml"))
    test.execute(test_start=lambda: "SN-0042")
"""

import mimetypes
from collections.abc import Callable
from pathlib import Path

from .measurement import load_measurement
from .protocol import make_protocol
from .requirements import Limit, read_requirements, Requirement
from .station import read_station, Station
from .write import write_protocol


_ATTACHED = ("protocol.pdf", "protocol.html", "protocol.json", "dcc.xml")


def protocol_phase(
    results: Path | str,
    output: Path | str,
    *,
    requirements: Path | str,
    station: Path | str | None = None,
    device: str | None = None,
) -> Callable[..., object]:
    """A phase that writes a protocol and attaches its documents.

    Of each requirement there are two measurements: its name, the decision, which passes where it is "pass", so that an
    undecided requirement fails the test; and its name with `.value`, the value nearest to the limit, SI.

    **Arguments:** `results` is the folder of `calibrate`, `diagnose` or `fleet`, read when the phase runs; `output` the
    folder for the documents; `requirements` and `station` are TOML files; `device` is a serial number where `results`
    holds several.

    Raises `ValueError` for requirements that cannot be read, and where OpenHTF is not installed.
    """
    try:
        import openhtf  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError(
            "`protocol_phase(...)`: needs OpenHTF; install it with `pip install 'inertiax[openhtf]'`."
        ) from None
    limits = read_requirements(Path(requirements))
    said = Station() if station is None else read_station(Path(station))
    measured = [m for limit in limits for m in _measurements(openhtf.Measurement, limit)]

    @openhtf.PhaseOptions(name="protocol")  # pyright: ignore[reportCallIssue]
    @openhtf.measures(*measured)
    def protocol(test) -> None:
        made = make_protocol(load_measurement(Path(results), device), said, limits)
        write_protocol(made, Path(output), "inertiax.protocol.openhtf_phase")
        for requirement in made.requirements:
            _tell(test.measurements, requirement)
        for name in _ATTACHED:
            kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
            test.attach(name, (Path(output) / name).read_bytes(), kind)

    return protocol


def _measurements(measurement: Callable, limit: Limit) -> list:
    decision = measurement(limit.name).equals("pass")
    decision = decision.doc(f"|{limit.name}| within {limit.text}, by guard band")
    return [decision, measurement(f"{limit.name}.value").doc("the value nearest to the limit, SI")]


def _tell(measurements, requirement: Requirement) -> None:
    measurements[requirement.name] = requirement.decision
    measurements[f"{requirement.name}.value"] = requirement.worst.value
