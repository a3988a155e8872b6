"""Navigation with the calibration inside."""
