"""The result of a calibration: one pytree, callable on raw outputs, with its JSON form."""
