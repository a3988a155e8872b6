"""Moments of a recording in words."""

EPOCH = 1e6  # s, 12 days: a clock that begins later counts from somewhere else, as Unix time does


def moment(seconds: float, first: float) -> str:
    """A moment on a recording's clock; from its first row on, where the clock counts from long before.

    **Arguments:** `seconds` on the clock, and the clock at the `first` row.

    ```python
    from inertiax.data.moments import moment

    print(moment(12.5, 0.0), "and", moment(1535630287.9, 1535630275.4))  # 12.5 s and 12.5 s after the first row
    ```
    """
    if abs(first) < EPOCH:
        return f"{seconds:.6g} s"
    return f"{seconds - first:.6g} s after the first row"
