"""Geometry, the error model and its composition, for one sample; no data and no estimation."""
