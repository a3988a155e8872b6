"""The error of a value that whoever calls chose, as against one of the data."""


class WrongValue(ValueError):
    """A name, a number or a choice that was asked for and cannot be: the command line ends with status 2 on it, and
    with 1 on any other `ValueError`, which says what is wrong with the data."""
