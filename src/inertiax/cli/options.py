"""Options and arguments that several commands have."""

from pathlib import Path
from typing import Annotated, Any

import typer


CampaignPath = Annotated[
    Path,
    typer.Argument(
        metavar="CAMPAIGN",
        exists=True,
        help="Folder with campaign.toml and recordings, or that file.",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result on standard output as one JSON document.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Go on although a plausibility check finds an error; it is a warning then."
    ),
]


def given_file(help: str, *names: str) -> Any:
    """An option that names a file that is there; by default it is called as the parameter is."""
    return typer.Option(*names, exists=True, dir_okay=False, metavar="FILE", help=help)


def written(metavar: str, help: str, **more: Any) -> Any:
    """The option that says where results go, a FILE or a DIR."""
    return typer.Option("-o", "--output", metavar=metavar, help=help, **more)


OutputFolder = Annotated[
    Path,
    written(
        "DIR",
        "Folder for the results; made if absent. Files written before are replaced, others are left alone.",
    ),
]
