"""`python -m inertiax` is the `inertiax` command."""

from .cli import main


main()
