"""Rests of a recording as it grows: the batch finder's on the rows so far, what disturbed them, their means."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..data.recording import Recording
from ..reduction.chord import shortening
from ..reduction.handling import Disturbance, NOUNS, undisturbed
from ..reduction.held_rests import kept_for_magnitude, variance_by_parts
from ..reduction.rests import find_rests, Rests, usual_step
from ..reduction.segments import segment
from ..reduction.turning_hand import with_variance_along


WINDOW = 1.0  # s, of the batch finder
BLOCK = 0.25  # s, of rows whose mean is one number about the noise of a rest's mean (convention)
POOLED = 20.0  # degrees of freedom, of all rests for one (convention: that of two rests of 3 s)
RECENT = 7  # rests that say what is usual when a new one is judged at once


@dataclasses.dataclass(eq=False)
class Rest:
    """One rest as it was said last."""

    number: int
    part: int  # recording
    start: int  # thinned rows [start, stop) of the recording, as found
    stop: int
    time: tuple[float, float]  # s, first and last row
    accepted: bool = True
    why: str | None = None
    disturbances: tuple[Disturbance, ...] = ()
    held: bool = False  # by hand: good for the magnitude of the force alone
    accel: Float[np.ndarray, "3"] | None = None  # m/s², mean
    accel_covariance: Float[np.ndarray, "3 3"] | None = None
    reference: Float[np.ndarray, "3"] | None = None
    gyro: Float[np.ndarray, "3"] | None = None  # rad/s
    gyro_covariance: Float[np.ndarray, "3 3"] | None = None
    temperature: float | None = None  # °C, mean of the first probe

    def overlaps(self, start: int, stop: int) -> bool:
        """Whether other ends mean the same rest: half of the shorter one is in both."""
        both = min(self.stop, stop) - max(self.start, start)
        return 2 * both > min(self.stop - self.start, stop - start)

    def is_like(self, start: int, stop: int, slack: int) -> bool:
        """Whether it is the rest with these ends, give or take `slack` rows at each."""
        return abs(self.start - start) <= slack and abs(self.stop - stop) <= slack

    def take(self, judged: "Judged") -> None:
        """Take over what was judged of it."""
        self.accepted, self.why = judged.why is None, judged.why
        self.disturbances, self.held = judged.disturbances, judged.held
        found = judged.means
        for key in (f.name for f in dataclasses.fields(Means)):
            setattr(self, key, None if found is None else getattr(found, key))


def labelled(recording: Recording) -> bool:
    """Whether the recording says itself when it rests."""
    return recording.position is not None or recording.reference_gyro is not None


def found_rests(recording: Recording) -> tuple[list[tuple[int, int, int]], Rests | None]:
    """Rests as (start, stop, position) before anything is said of disturbances, and the finder's answer; `None` where
    positions say when it rests."""
    if labelled(recording):
        found = segment(recording, window=WINDOW, handling=False)
        kept = np.flatnonzero(found.resting)
        rows = zip(found.start[kept], found.stop[kept], found.position[kept])
        finder = None if recording.position is not None else find_rests(recording, window=WINDOW)
        return [(int(a), int(b), int(p)) for a, b, p in rows], finder
    rests = find_rests(recording, window=WINDOW)
    ends = [(int(a), int(b), k) for k, (a, b) in enumerate(zip(rests.start, rests.stop))]
    return ends, rests


@dataclasses.dataclass(frozen=True, eq=False)
class Judged:
    """One rest after what disturbed it was looked for."""

    start: int
    stop: int
    why: str | None  # `None`: accepted
    disturbances: tuple[Disturbance, ...]
    held: bool
    means: "Means | None"


def matched(
    before: list[Rest], judged: list[tuple[Judged, Rest]], slack: int
) -> tuple[list[Rest], list[Rest]]:
    """Rests whose verdict or ends changed, and those that are new.

    **Arguments:** `judged` holds each rest as it is judged now, and what it would be as a new one; an end that moves by
    `slack` rows or fewer is no change.
    """
    changed, added, left = [], [], list(before)
    for one, fresh in judged:
        match = next((r for r in left if r.overlaps(one.start, one.stop)), None)
        if match is None:
            fresh.take(one)
            added.append(fresh)
            continue
        left.remove(match)
        was, alike = match.accepted, match.is_like(one.start, one.stop, slack)
        match.start, match.stop, match.time = fresh.start, fresh.stop, fresh.time
        match.take(one)
        if match.accepted != was or not alike:
            changed.append(match)
    for rest in left:  # the longer recording shows no such rest
        if rest.accepted:
            rest.accepted, rest.why = False, "motion, by what the longer recording shows"
            changed.append(rest)
    return changed, added


@dataclasses.dataclass(frozen=True, eq=False)
class Means:
    """Means over one rest without what was disturbed."""

    accel: Float[np.ndarray, "3"] | None
    accel_covariance: Float[np.ndarray, "3 3"] | None
    reference: Float[np.ndarray, "3"] | None
    gyro: Float[np.ndarray, "3"] | None
    gyro_covariance: Float[np.ndarray, "3 3"] | None
    temperature: float | None


def judge(
    picked: Recording,
    averaged: Recording,
    rests: list[tuple[int, int, int]],
    *,
    by_magnitude: bool = False,
) -> list[Judged]:
    """What is left of rests of one recording, each judged by what is usual among them.

    **Arguments:** samples as they came, for what looks at samples, and means over the rows that each stands for; with
    `by_magnitude` rests that a hand held stay, for |a|, as in the batch estimate.
    """
    start, stop, position = (np.array(x, dtype=np.int64) for x in zip(*rests))
    left = undisturbed(picked, start, stop, position)
    held = np.zeros(len(start), bool)
    if by_magnitude:
        held = kept_for_magnitude(left, start, stop, position, usual_step(picked))
    rows = {}
    for k, (a, b) in enumerate(zip(left.start, left.stop)):
        if k < len(held) and held[k]:
            rows[k] = np.arange(start[k], stop[k])
        elif a < b:
            rows[k] = a + np.flatnonzero(left.used[a:b])
    by_hand = [bool(held[k]) if k < len(held) else False for k in rows]
    means = dict(zip(rows, _means(averaged, list(rows.values()), by_hand)))
    made = []
    for k, (a, b, label) in enumerate(rests):
        mine = tuple(
            d for d in left.disturbances if d.position == label and _inside(d, picked, a, b)
        )
        why = None if k in means else _why(mine)
        made.append(Judged(a, b, why, mine, bool(held[k]), means.get(k)))
    return made


def _inside(found: Disturbance, recording: Recording, start: int, stop: int) -> bool:
    time = recording.time
    return bool(time[start] <= found.start <= time[stop - 1])


def _why(found: tuple[Disturbance, ...]) -> str:
    """Why nothing is left of a rest."""
    out = [d for d in found if d.left_out]
    if not out:
        return "nothing of it is at rest"
    words = dict.fromkeys(f"{NOUNS[d.kind][0]} at {d.start:.1f} s" for d in out)
    return ", ".join(list(words)[-3:])


def _means(
    recording: Recording, rests: list[Int[np.ndarray, " _"]], held: list[bool]
) -> list[Means]:
    """Means over the rows of each rest, of those `held` by hand with the variances that their parts show."""
    step = usual_step(recording)
    known = recording.reference_accel

    def of(values: Float[np.ndarray, "time 3"] | None, *, turned: bool = False):
        if values is None:
            return [(None, None)] * len(rests)
        parts = [values[rows] for rows in rests]
        made = np.zeros((len(parts), 3, 3))
        for group in (
            np.array(held, bool),
            ~np.array(held, bool),
        ):  # a hand tells nothing of a table
            some = [parts[k] for k in np.flatnonzero(group)]
            if some:
                made[group] = mean_covariances(some, step, turned=turned)
        for k in np.flatnonzero(held):
            shown = variance_by_parts(parts[k], np.array([0]), np.array([len(parts[k])]))[0]
            made[k] += np.diag(np.maximum(shown - np.diagonal(made[k]), 0.0))
        return [(x.mean(axis=0), c) for x, c in zip(parts, made)]

    references = [None if known is None else known[rows].mean(axis=0) for rows in rests]
    probes = recording.temperature
    warm = [None if probes is None else float(probes[rows, 0].mean()) for rows in rests]
    both = zip(of(recording.accel, turned=known is None), references, of(recording.gyro), warm)
    made = [Means(a, va, r, g, vg, t) for (a, va), r, (g, vg), t in both]
    if recording.accel is None or known is not None or not rests:
        return made
    starts = np.cumsum([len(rows) for rows in rests]) - [len(rows) for rows in rests]
    longer = 1.0 + shortening(recording.accel[np.concatenate(rests)], starts)
    return [
        dataclasses.replace(m, accel=None if m.accel is None else factor * m.accel)
        for m, factor in zip(made, longer, strict=True)
    ]


def mean_covariances(
    rests: list[Float[np.ndarray, "_ 3"]], step: float, *, turned: bool = False
) -> list[Float[np.ndarray, "3 3"]]:
    """Covariance of the mean of each rest, by how the means of short blocks scatter within it (batch means).

    Blocks hold noise with a memory shorter than they are. A rest has few of them, so its variance is drawn towards that
    of all rests together, as if those were worth `POOLED` degrees of freedom. With `turned`, a hand may turn gravity
    across itself in all rests, and the variance along it is by its own blocks (`turning_hand`). **Arguments:** `step`
    from row to row, s.
    """
    size = max(round(BLOCK / step), 1) if step > 0.0 else 1
    covariances = np.array([np.diag(v) for v in _batch_variances(rests, size)])
    if not turned or not rests:
        return list(covariances)
    means = np.array([x.mean(axis=0) for x in rests])
    u = means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-300)
    along = _batch_variances([(x @ d)[:, None] for x, d in zip(rests, u)], size)[:, 0]
    return list(with_variance_along(covariances, u, along))


def _batch_variances(
    rests: list[Float[np.ndarray, "_ channel"]], size: int
) -> Float[np.ndarray, "rest channel"]:
    """Variance of each rest's mean by blocks of `size` rows."""
    channels = rests[0].shape[1] if rests else 3
    own, freedom = np.zeros((len(rests), channels)), np.zeros(len(rests))
    for k, x in enumerate(rests):
        blocks = len(x) // size
        if blocks > 1:
            means = x[: blocks * size].reshape(blocks, size, channels).mean(axis=1)
            own[k], freedom[k] = means.var(axis=0, ddof=1), blocks - 1.0
    pooled = freedom @ own / max(freedom.sum(), 1.0)
    variance = (POOLED * pooled + freedom[:, None] * own) / (POOLED + freedom)[:, None]
    counts = np.array([max(len(x) / size, 1.0) for x in rests])
    return variance / counts[:, None]
