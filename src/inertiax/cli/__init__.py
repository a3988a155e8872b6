"""The command line: one file per command, collected in `app`. Importing it loads no JAX."""

from .app import app as app, main as main
