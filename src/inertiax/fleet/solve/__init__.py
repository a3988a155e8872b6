"""Dwell means of many devices to parameters, in one program."""
