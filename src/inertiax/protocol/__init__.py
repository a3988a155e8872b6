"""The protocol of a calibration: what was measured, how well, against which requirements; for people and machines."""
