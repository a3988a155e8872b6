"""Studies of the method: error budget, reference methods, the founding paper's experiment."""
