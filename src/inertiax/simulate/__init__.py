"""A test station and a device with known truth: two-axis table, thermal chamber, sensor triads."""
