"""No result replaces what its own command reads, by whatever path, symbolic or hard link it is called."""

from collections.abc import Iterable
from pathlib import Path

import typer


def require_other_than(output: Path, inputs: Iterable[Path | None]) -> None:
    """Check that a result's file is none of the files that are read, nor inside a folder that is read as one recording.

    Raises `typer.BadParameter` (status 2) where it is. What is not there yet replaces nothing.
    """
    for read in inputs:
        if read is not None and _is_within(output, read):
            raise typer.BadParameter(
                f"'{output}' is read by this command, and would be replaced; name another place.",
                param_hint="'-o'",
            )


def require_kept(folder: Path, names: Iterable[str], inputs: Iterable[Path | None]) -> None:
    """The same of each file of that name in a results folder."""
    read = tuple(inputs)
    for name in names:
        require_other_than(folder / name, read)


def require_no_recording(
    output: Path, calibration: Path | None, campaign: Path | None = None
) -> None:
    """Check that a result's file is no recording of the campaign that a calibration was made of, nor of the one beside
    it or given; what `inertiax compensate` wrote is none.

    Raises `typer.BadParameter` (status 2) where it is.
    """
    from ..data.campaign import campaign_beside
    from ..data.compensated import is_compensated
    from ..protocol.record import was_made_of

    if not output.is_file() or is_compensated(output):
        return
    named = any(output.samefile(f) for f in files_of(campaign) if f.is_file())
    made = calibration is not None and was_made_of(calibration, output)
    if named or made or campaign_beside(output) is not None:
        raise typer.BadParameter(
            f"'{output}' is a recording of a campaign, and would be replaced; name another place.",
            param_hint="'-o'",
        )


def files_of(campaign: Path | None) -> tuple[Path, ...]:
    """`campaign.toml` and the files that it names, as far as it can be read; who reads it says what is wrong."""
    if campaign is None:
        return ()
    from ..data.inputs import campaign_files

    file = campaign / "campaign.toml" if campaign.is_dir() else campaign
    try:
        return campaign_files(file)
    except (ValueError, OSError):
        return (file,)


def _is_within(output: Path, read: Path) -> bool:
    try:
        if not output.exists() or not read.exists():
            return False
        return output.samefile(read) or (
            read.is_dir() and output.resolve().is_relative_to(read.resolve())
        )
    except OSError:  # a place that cannot be looked at is refused where it is written
        return False
