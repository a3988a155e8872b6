"""The iterative calibration procedure over temperature, and its least-squares forms."""
