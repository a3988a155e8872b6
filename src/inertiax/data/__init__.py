"""What was measured: recordings and campaigns in SI units, and how they are read."""
