"""Mathematics that knows nothing of sensors: least squares, small dense solvers, excess variance."""
