"""The sentences of a diagnosis."""
