"""inertiax: differentiable calibration of inertial measurement units."""
