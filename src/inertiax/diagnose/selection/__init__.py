"""Which effects are accepted."""
