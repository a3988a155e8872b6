"""Imported by a command that works on the host alone, before any record is: these are then made without JAX."""
