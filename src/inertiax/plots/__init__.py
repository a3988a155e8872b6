"""Figures; the only importer of matplotlib. Functions draw on a given `ax` or build a `Figure`."""
