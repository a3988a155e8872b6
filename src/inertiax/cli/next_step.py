"""The last line of a command: the command to run next, to be copied."""

import shlex
from pathlib import Path


def after_init(folder: Path, *, checks: bool) -> str:
    """Calibrate, once what the log does not tell is put right."""
    first = "mend the lines marked CHECK, then " if checks else ""
    return f"next: {first}inertiax calibrate {_path(folder)} -o RESULT"


def after_calibrate(verdict: str, campaign: Path, output: Path, *, table: bool) -> str:
    """By the verdict of `is it good?`; a station also wants a protocol."""
    if verdict == "doubtful":
        return f"next: inertiax check {_path(campaign)}"
    if verdict == "usable":
        return f"next: inertiax diagnose {_path(campaign)} -o DIAGNOSIS"
    return f"next: {_compensate(campaign, output)}{_sign(output) if table else ''}"


def after_diagnose(verdict: str, campaign: Path, output: Path) -> str:
    """Use the calibration; of something unexplained, look where it is."""
    if verdict == "unexplained":
        return (
            f"next: look where it is in {_path(output / 'report.html')}; docs/how-to/unexplained.md"
        )
    return f"next: {_compensate(campaign, output)}{_sign(output)}"


def _compensate(campaign: Path, output: Path) -> str:
    file = _path(output / "calibration.json")
    return f"inertiax compensate {file} LOG --campaign {_path(campaign)} -o OUT.csv"


def _sign(output: Path) -> str:
    return f"; to sign: inertiax protocol {_path(output)} -o PROTOCOL"


def _path(path: Path) -> str:
    return shlex.quote(str(path))
