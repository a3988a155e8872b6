"""The last line of a command: the command to run next, to be copied."""

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from . import console


if TYPE_CHECKING:
    from ..calibrate.fit_quality import Quality

# A remark on a key, as `campaign_draft.toml_text` writes it, which needs JAX to import.
_MARKED = re.compile(r"^# CHECK (\w+):", re.MULTILINE)
# Lines of `[model]` that a finding asks for.
_LEVER_ARMS = "lever_arms = true"
_LINES = (_LEVER_ARMS, "g_sensitivity = true")


def after_init(folder: Path, *, checks: bool) -> str:
    """Calibrate, once what the log does not tell is put right."""
    first = "mend the lines marked CHECK, then " if checks else ""
    return f"next: {first}inertiax calibrate {_path(folder)} -o RESULT"


def say_what_is_open(campaign: Path) -> None:
    """Lines of the campaign that the log did not tell and nobody has settled since."""
    file = campaign if campaign.suffix == ".toml" else campaign / "campaign.toml"
    try:
        names = dict.fromkeys(_MARKED.findall(file.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError):
        return
    if names:
        console.say(
            f"{file.name} still marks CHECK: {', '.join(names)}. The result is as right as that; take the mark away "
            "from what is."
        )


def after_calibrate(
    quality: "Quality", campaign: Path, output: Path, *, table: bool, triads: bool = True
) -> str:
    """By what `is it good?` says; a station also wants a protocol. A diagnosis is of accelerometers and gyros: without
    these `triads` there is none."""
    if any(f.topic == "one_attitude" for f in quality.findings):
        return (
            "next: inertiax init and inertiax calibrate of each log into a folder of its own, then inertiax export "
            "HAND/calibration.json --warm-up WARM/calibration.json --to FORMAT"
        )
    asked = [line for line in _LINES if any(line in f.text for f in quality.findings)]
    if asked:
        return _again_with(asked, campaign, output)
    if quality.verdict == "doubtful":
        return f"next: inertiax check {_path(campaign)}"
    if triads and any(f.topic == "misfit" and not f.fine for f in quality.findings):
        return f"next: inertiax diagnose {_path(campaign)} -o DIAGNOSIS"
    return f"next: {_compensate(campaign, output)}{_sign(output) if table else ''}"


def after_diagnose(verdict: str, campaign: Path, output: Path, *, lever_arms: bool = False) -> str:
    """Use the calibration; of something unexplained, look where it is. Lever arms that were found and not fitted are
    fitted first."""
    if lever_arms:
        return _again_with([_LEVER_ARMS], campaign, Path("RESULT"))
    if verdict == "unexplained":
        return (
            f"next: look where it is in {_path(output / 'report.html')}; docs/how-to/unexplained.md"
        )
    return f"next: {_compensate(campaign, output)}{_sign(output)}"


def after_fleet(campaign: Path, reserved: Sequence[str]) -> str:
    """Diagnose the first device whose fit is not good, where each has a folder of its own; else nothing."""
    for device in reserved:
        for folder in (campaign / device, campaign / Path(device).parent):
            if folder != campaign and (folder / "campaign.toml").is_file():
                rest = "" if len(reserved) == 1 else f"; likewise of {len(reserved) - 1} more"
                return f"next: inertiax diagnose {_path(folder)} -o DIAGNOSIS{rest}"
    return ""


def _again_with(lines: Sequence[str], campaign: Path, output: Path) -> str:
    file = _path(campaign if campaign.suffix == ".toml" else campaign / "campaign.toml")
    again = f"inertiax calibrate {_path(campaign)} -o {_path(output)}"
    return f"next: write {' and '.join(lines)} under [model] in {file}, then {again}"


def _compensate(campaign: Path, output: Path) -> str:
    file = _path(output / "calibration.json")
    return f"inertiax compensate {file} LOG --campaign {_path(campaign)} -o OUT.csv"


def _sign(output: Path) -> str:
    return f"; to sign: inertiax protocol {_path(output)} -o PROTOCOL"


def _path(path: Path) -> str:
    return shlex.quote(str(path))
