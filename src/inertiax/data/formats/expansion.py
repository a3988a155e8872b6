"""How much a file may hold beyond its own size: a small file that unpacks to all of the memory is refused."""

FREE = 1 << 28  # bytes that any file may unpack to
RATIO = 200  # beyond: times its size on disk; noise of real sensors packs less than tenfold


def limit(stored: int) -> int:
    """Bytes that a file of `stored` bytes may unpack to."""
    return max(FREE, RATIO * stored)


def require_plausible(unpacked: int, stored: int, where: str) -> None:
    """Raises `ValueError` where a file claims to hold more than `limit`."""
    if unpacked > limit(stored):
        raise ValueError(
            f"{where}: the file has {stored} bytes but claims {unpacked:.3g} bytes of data, more than a "
            f"recording packs into that; write it again without compression if it is meant."
        )
