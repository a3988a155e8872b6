"""Moments of a recording in words."""

EPOCH = 1e6  # s, 12 days: a clock that begins later counts from somewhere else, as Unix time does


AFTER = "s after the first row"
UNIX = (0.9e9, 2.5e9)  # s since 1970: 1998 to 2049


def since(seconds: float, first: float) -> float:
    """Seconds to show of a moment: as the clock has it, or from the `first` row on where it counts from long before."""
    return seconds if abs(first) < EPOCH else seconds - first


def unit_of_moments(first: float) -> str:
    """The unit of what `since` gives, in words."""
    return "s" if abs(first) < EPOCH else AFTER


def moment(seconds: float, first: float) -> str:
    """A moment on a recording's clock; from its first row on, where the clock counts from long before.

    **Arguments:** `seconds` on the clock, and the clock at the `first` row.

    ```python
    from inertiax.data.moments import moment

    print(moment(12.5, 0.0), "and", moment(1535630287.9, 1535630275.4))  # 12.5 s and 12.5 s after the first row
    ```
    """
    return f"{since(seconds, first):.6g} {unit_of_moments(first)}"
