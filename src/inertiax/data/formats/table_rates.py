"""How fast the axes of a table turn, by its angles and what it states of rates.

A station may state one rate, that of the axis it commands, and zero while it moves to a position: `rates_by_axis` tells
by the angles which axis that is, and how fast the others turn. It may write the rate that it was told while the table
still speeds up to it: there the angles decide. `rates_of_angles` is for a station that states none.
"""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from .held_angles import held_rows, NO_DIGIT, whole_turns_away, without_stairs


_WHILE = 0.01  # s to either side: an encoder's noise of 0.001° is 0.1 °/s then
# The smallest tenth of changes is at rest; of a Gaussian 0.126 σ is the quantile of the absolute value.
_STANDS, _STANDS_SIGMA = 0.1, 0.126
_SLOW = math.radians(0.1)  # rad/s, below which an axis stands
_OTHER = 0.5  # of the turn that a rate makes: further off it is not that of any axis
_SIGMAS = 5.0  # of an encoder's noise, beyond which a stated rate is not the angles', or theirs not constant
_BASE = 0.1  # s to either side, over which the angles alone say a rate
# s, and of a move's duration, and at most: rows at its ends, in which a smooth ramp (of third order in time) is slower
# than an encoder's noise tells. Of a half turn in 30 s they make 130 ppm (convention).
_TAIL, _TAIL_SHARE, _LONGEST_TAIL = 0.1, 0.08, 2.0
_WOBBLE = 2e-3  # of a rate, by which a table that holds it may miss it (convention)
_SHORT = 1e-4  # of the angle through which an axis turns at a constant rate, by which that may miss it (convention)
_SELDOM = 0.02  # of the rows in which an axis stands, that it may step in (convention)
_HELD = 0.5  # s, the shortest stretch of constant rate
_JUMP = 0.5  # of the rate, from one row's side to the other: no table speeds up so fast
_ROUNDED = (
    1.5  # of an encoder's digit, by which a change of angle may be off, and a rate's own digits
)


def rates_by_axis(
    angles: Float[np.ndarray, "rows axes"],
    stated: Float[np.ndarray, "rows columns"],
    time: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows axes"]:
    """The rate of each axis, rad/s, where a station states all of them, or one alone, that of the axis that turns.

    That is the axis with which the change of the angles, up to whole turns, is nearest to what the rate makes of it.
    Where all stated rates are zero and an angle changes, the table moves to a position; where the angles change
    otherwise than is stated, it still speeds up or slows down. There the rate is the angles' change.

    **Arguments:** `angles` in rad, NaN where they are not told; `stated` in rad/s, one column or one for each angle;
    `time` in s.

    Raises `ValueError` for another number of columns, and for one rate that is not the change of any angle.

    ```python
    import numpy as np
    from inertiax.data.formats.table_rates import rates_by_axis

    time = 0.1 * np.arange(5)
    angles = np.stack([np.full(5, 0.7), 2.0 * time], axis=1)    # the second axis turns by 2 rad/s
    print(rates_by_axis(angles, np.full((5, 1), 2.0), time)[2])    # [0. 2.]
    ```
    """
    many = angles.shape[1]
    if stated.shape[1] not in (1, many):
        raise ValueError(
            "[columns] table_rates: name one column for each of table_angles, or one alone, the rate of the axis that "
            "turns."
        )
    if len(time) < 3:
        return np.broadcast_to(stated, angles.shape).copy()
    held = held_rows(angles)
    near = max(1, math.ceil(_WHILE / max(float(np.median(np.diff(time))), 1e-9) - 1e-6))
    near = near if held == 1 else _in_steps(max(near, 2 * held), held)
    turn, spent = _change(angles, time, near)
    rates = np.array(stated)
    if stated.shape[1] < many:
        rates = np.zeros(angles.shape)
        # By the side that fits better: a plateau may begin with a jump from the part of the log before.
        cost = np.fmin(*(_misses(side, stated) for side in _sides(angles, time, near)))
        told = np.isfinite(cost).all(axis=1)
        asked = told & (np.abs(stated[:, 0]) > _SLOW)
        away = cost[asked].min(axis=1) / np.abs(stated[asked, 0])
        if asked.any() and np.median(away) > _OTHER:
            raise ValueError(
                "[columns] table_rates: one column for several axes is the rate of the axis that turns, and here it is "
                "not the change of any of table_angles; name one column for each of them."
            )
        rows = np.flatnonzero(told)
        rates[rows, cost[rows].argmin(axis=1)] = stated[rows, 0]
    zero = np.all(stated == 0.0, axis=1)
    unsaid = _turning(angles, time, near, zero)
    unsaid = (unsaid | zero & _beside(unsaid, time)) & np.isfinite(spent)
    if held > 1:  # over fewer rows: the angles' own change, no mean of it
        turn, spent = _change(without_stairs(angles, time), time, 1)
    unsaid |= _steps(angles, time, zero & ~unsaid & np.isfinite(spent))
    rates[unsaid] = turn[unsaid] / spent[unsaid, None]
    rates += _late(angles, time, near, rates, ~zero)
    return rates


def rates_of_angles(
    angles: Float[np.ndarray, "rows axes"], time: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, "rows axes"]:
    """The rate of each axis, rad/s, by the angles alone: their change, and its mean where that stays constant.

    Constant is a rate that is the same 0.1 s earlier and later, but for an encoder's noise, for half a second or more.

    **Arguments:** `angles` in rad, NaN where they are not told, and so is the rate; `time` in s.

    ```python
    import numpy as np
    from inertiax.data.formats.table_rates import rates_of_angles

    time = 0.01 * np.arange(300)
    print(rates_of_angles(2.0 * time[:, None], time)[150])    # [2.]
    ```
    """
    rates = rates_by_axis(angles, np.zeros(angles.shape), time)
    rates[~np.isfinite(angles).all(axis=1)] = np.nan
    near = (
        max(1, math.ceil(_BASE / max(float(np.median(np.diff(time))), 1e-9) - 1e-6))
        if len(time) > 1
        else 1
    )
    held = held_rows(angles)
    near = _in_steps(near, held)
    if len(time) < 4 * near + 1:
        return rates
    turn, spent = _change(angles, time, near)
    mean = np.full(angles.shape, np.nan)
    # Half a turn and more within the base is told by the rate over fewer rows.
    mean[near:-near] = (rates + whole_turns_away(turn - rates * spent[:, None]) / spent[:, None])[
        near:-near
    ]
    differs = np.full(angles.shape, np.nan)
    differs[near:-near] = np.abs(mean[2 * near :] - mean[: -2 * near])
    with np.errstate(invalid="ignore"):
        turning = np.abs(mean).max(axis=1) > _SLOW
        told = turning & np.isfinite(differs).all(axis=1)
        if not told.any():
            return rates
        # Where an axis turns at no constant rate, what that changes is no noise.
        still = np.isfinite(differs).all(axis=1) & ~turning
        quiet = _noise(differs[still]) if still.any() else np.inf
        digit = _ROUNDED * _digit(angles) / float(np.median(spent[told]))
        most = np.maximum(np.maximum(_SIGMAS * quiet, digit), _WOBBLE * np.abs(mean))
        each = [_of_one_axis(differs[told, k], np.abs(v), told) for k, v in enumerate(mean.T)]
        least = np.maximum(_SLOW / 5.0, np.minimum(_SIGMAS * np.stack(each, axis=1), most))
        edges = np.flatnonzero(np.diff(np.r_[0, told & (differs <= least).all(axis=1), 0]))
    for a, b in edges.reshape(-1, 2):
        if time[b - 1] - time[a] >= _HELD:
            # Of stairs the first row of each step, which is on the line.
            rows = np.arange(a, b)[_fresh(angles[a:b]) if held > 1 else slice(None)]
            seconds = time[rows] - time[rows].mean()
            middle = mean[(a + b) // 2]
            away = np.unwrap(angles[rows] - middle * seconds[:, None], axis=0)
            line = middle + seconds @ away / (seconds @ seconds)
            # A smooth move's slow ends and its flat top are no constant rate: a line would miss the angle.
            turned = (time[b - 1] - time[a]) * np.array([rates[a:b].mean(axis=0) - line, line])
            noise = np.maximum(0.5 * _SIGMAS * quiet * np.median(spent[told]), _digit(angles))
            if np.all(np.abs(turned[0]) <= np.maximum(noise, _SHORT * np.abs(turned[1]).max())):
                rates[a:b] = line
    return rates


def _fresh(angles: Float[np.ndarray, "rows axes"]) -> Bool[np.ndarray, " rows"]:
    """Rows in which an angle is another than in the row before."""
    return np.r_[False, (np.abs(np.diff(angles, axis=0)) > NO_DIGIT).any(axis=1)]


def _in_steps(rows: int, held: int) -> int:
    """So many rows or a few more, that a stair's steps fit in: then the change over them is that of a straight line."""
    return -(-rows // held) * held


def _late(
    angles: Float[np.ndarray, "rows axes"],
    time: Float[np.ndarray, " rows"],
    near: int,
    rates: Float[np.ndarray, "rows axes"],
    said: Bool[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows axes"]:
    """By how much the angles' change misses stated rates, rad/s: where it does so before and after each row, by more
    than an encoder's noise and digits. Zero elsewhere."""
    sides = np.stack(
        [
            whole_turns_away(turn - rates * spent[:, None]) / spent[:, None]
            for turn, spent in _sides(angles, time, near)
        ]
    )
    off = np.abs(sides).max(axis=2)
    nearest = np.fmin(*off)
    told = said & np.isfinite(nearest)
    if not told.any():
        return np.zeros(angles.shape)
    size = np.abs(rates).max(axis=1)
    digit = _digit(angles)
    every = near * float(np.median(np.diff(time)))
    # Noise of the angles, and of the stamps, which is in proportion to the rate.
    noise = np.maximum(_noise(nearest[told]), _noise(nearest[told] / size[told]) * size)
    late = told & (nearest > np.maximum(_SIGMAS * noise, max(_SLOW, _ROUNDED * digit / every)))
    # A jump from another part of the log is on one side alone.
    both = off.max(axis=0) - nearest < _JUMP * size
    one = np.where((off[0] == nearest)[:, None], *sides)
    return np.where(late[:, None], np.where(both[:, None], sides.mean(axis=0), one), 0.0)


def _digit(angles: Float[np.ndarray, "rows axes"]) -> float:
    """The smallest change of an angle from row to row, rad."""
    steps = np.abs(whole_turns_away(np.diff(angles, axis=0)))
    return float(np.min(steps, initial=np.inf, where=steps > NO_DIGIT))


def _of_one_axis(
    differs: Float[np.ndarray, " told"],
    speed: Float[np.ndarray, " rows"],
    told: Bool[np.ndarray, " rows"],
) -> Float[np.ndarray, " rows"]:
    """Noise of an axis' rate where it stands while another turns, and where it turns itself: an encoder's, and that of
    rounded stamps, which is in proportion to the rate. Together, the zeros of standing would be the noise of both."""
    turns = speed[told] > _SLOW
    made = np.zeros(len(speed))
    if not turns.all():
        made[:] = _noise(differs[~turns])
    if turns.any():
        own = differs[turns]
        own = np.maximum(_noise(own), _noise(own / speed[told][turns]) * speed)
        made = np.where(speed > _SLOW, own, made)
    return made


def _noise(
    quiet: Float[np.ndarray, "rows *columns"],
) -> Float[np.ndarray, "*columns"] | np.floating:
    """Standard deviation of Gaussian noise of which these are absolute values, and larger ones of something else."""
    return np.quantile(quiet, _STANDS, axis=0) / _STANDS_SIGMA


def _sides(
    angles: Float[np.ndarray, "rows axes"], time: Float[np.ndarray, " rows"], near: int
) -> Iterator[tuple[Float[np.ndarray, "rows axes"], Float[np.ndarray, " rows"]]]:
    """Change of the angles from so many rows before to each, then from each to as many after, and the seconds; NaN
    where there are none."""
    for back, on in ((near, 0), (0, near)):
        turn, spent = np.full(angles.shape, np.nan), np.full(len(time), np.nan)
        turn[back : len(time) - on] = angles[near:] - angles[:-near]
        spent[back : len(time) - on] = time[near:] - time[:-near]
        yield whole_turns_away(turn), np.where(spent > 0.0, spent, np.nan)


def _misses(
    side: tuple[Float[np.ndarray, "rows axes"], Float[np.ndarray, " rows"]],
    stated: Float[np.ndarray, "rows 1"],
) -> Float[np.ndarray, "rows axes"]:
    """How far off the angles' changes are, rad/s, if that axis alone turns at the stated rate."""
    turn, spent = side
    miss = np.abs(whole_turns_away(turn - stated * spent[:, None]))
    stands = np.abs(turn)
    return (miss + stands.sum(axis=1, keepdims=True) - stands) / spent[:, None]


def _turning(
    angles: Float[np.ndarray, "rows axes"],
    time: Float[np.ndarray, " rows"],
    near: int,
    unsaid: Bool[np.ndarray, " rows"],
) -> Bool[np.ndarray, " rows"]:
    """Rows before and after which an axis turns the same way, by more than an encoder's noise, and their neighbours: no
    jump from one part of a log to the next, and no rest beside a plateau."""
    here = np.arange(len(time))
    before, after = np.maximum(here - near, 0), np.minimum(here + near, len(time) - 1)
    came, goes = (
        whole_turns_away(angles - angles[before]),
        whole_turns_away(angles[after] - angles),
    )
    quiet = np.abs(came[unsaid & np.isfinite(came).all(axis=1)])
    noise = _noise(quiet) if len(quiet) else 0.0
    with np.errstate(invalid="ignore"):
        least = np.maximum(_SLOW * (time[after] - time)[:, None], _SIGMAS * noise)
        turns = lambda part: np.abs(part) > least
        inside = unsaid & (turns(came) & turns(goes) & (came * goes > 0.0)).any(axis=1)
        some = (turns(came) | turns(goes)).any(axis=1)
    ends = inside[before] | inside[after]
    return unsaid & (inside | ends & some) & np.isfinite(came + goes).all(axis=1)


def _steps(
    angles: Float[np.ndarray, "rows axes"],
    time: Float[np.ndarray, " rows"],
    stands: Bool[np.ndarray, " rows"],
) -> Bool[np.ndarray, " rows"]:
    """Rows about which an axis that stands steps by arc seconds, as where it is told to go to where it is nearly.

    A move's mean rate would lack them. None where it does so all the time: that is how its servo stands.
    """
    step = np.abs(whole_turns_away(np.diff(angles, axis=0)))
    among = stands[1:] & stands[:-1] & np.isfinite(step).all(axis=1)
    if not among.any():
        return np.zeros(len(angles), bool)
    least = np.maximum(_SIGMAS * _noise(step[among]), _ROUNDED * _digit(angles))
    seldom = (step[among] > least).mean(axis=0) <= _SELDOM
    seen = (
        _SLOW * np.diff(time)[:, None]
    )  # by `_turning`, or a jump from one part of a log to the next
    found = among & ((step > least) & (step < seen) & seldom).any(axis=1)
    return np.append(found, False) | np.append(False, found)


def _beside(
    turning: Bool[np.ndarray, " rows"], time: Float[np.ndarray, " rows"]
) -> Bool[np.ndarray, " rows"]:
    """Rows just before and after those in which an axis turns, where a smooth ramp is within an encoder's noise.

    Without them a move would be short of its angle."""
    edges = np.flatnonzero(np.diff(np.r_[0, turning, 0])).reshape(-1, 2)
    # A plateau's row or two are no move.
    first, last = edges[time[edges[:, 1] - 1] - time[edges[:, 0]] > _TAIL].T - [[0], [1]]
    tail = np.minimum(_TAIL + _TAIL_SHARE * np.abs(time[last] - time[first]), _LONGEST_TAIL)
    here = np.arange(len(time))
    before = np.minimum(
        np.searchsorted(last, here), len(last) - 1
    )  # the run that ends here or later
    after = np.maximum(np.searchsorted(first, here, side="right") - 1, 0)  # that began before
    if not len(first):
        return np.zeros(len(time), bool)
    ahead, behind = time[first[before]] - time, time - time[last[after]]
    return (np.abs(ahead) <= tail[before]) | (np.abs(behind) <= tail[after])


def _change(
    angles: Float[np.ndarray, "rows axes"], time: Float[np.ndarray, " rows"], rows: int
) -> tuple[Float[np.ndarray, "rows axes"], Float[np.ndarray, " rows"]]:
    """Change of the angles between so many rows before and after each, within half a turn, and the seconds between;
    NaN where the clock goes back (another device)."""
    here = np.arange(len(time))
    before, after = np.maximum(here - rows, 0), np.minimum(here + rows, len(time) - 1)
    spent = time[after] - time[before]
    spent = np.where(spent > 0.0, spent, np.nan)
    return whole_turns_away(angles[after] - angles[before]), spent
