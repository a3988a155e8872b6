"""A run with given steps, followed rest by rest: which step comes next, and whether all are done."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from .next_position import NextPosition
from .rest_ledger import Rest


NEAR = np.radians(15.0)  # from the direction that was told: a hand's 10° and a wide margin
PART = 0.8  # of a step's seconds from which it counts: a rest loses a second at each end
LONG = 1200.0  # s of rest that are enough for any step: longer ones are searched in parts of half an hour


@dataclasses.dataclass(frozen=True)
class Step:
    """One rest of a run."""

    up: tuple[float, float, float]  # direction of the specific force in case axes
    statement: str
    seconds: float
    temperature: float | None = None  # °C that the chamber is to reach meanwhile
    afresh: bool = False  # after a power cycle: in another recording than the step before

    def off(self, rest: Rest) -> float:
        """How far a rest is from this step's direction, rad; where accelerometers are not recorded, any is on it."""
        if rest.accel is None:
            return 0.0
        force = rest.accel / np.linalg.norm(rest.accel)
        return float(np.arccos(np.clip(force @ np.array(self.up), -1.0, 1.0)))

    def takes(self, rest: Rest) -> bool:
        """Whether a rest is in this step's direction."""
        return bool(self.off(rest) < NEAR)

    @property
    def enough(self) -> float:
        """Seconds of rest from which the step counts."""
        return min(PART * self.seconds, LONG)


@dataclasses.dataclass(frozen=True)
class Itinerary:
    """Steps in their order, and what is to be done after them."""

    steps: tuple[Step, ...]
    then: tuple[tuple[str, float], ...] = ()  # turns: in words, and their rate, rad/s

    def done(self, rests: Sequence[Rest]) -> int:
        """How many steps the accepted rests have done, in order; rests elsewhere count for none.

        A rest that is long enough does several steps of its direction, of which none begins afresh.
        """
        place, part = 0, None
        for rest in rests:
            left = rest.time[1] - rest.time[0]
            first = True
            while place < len(self.steps):
                step = self.steps[place]
                same = not step.afresh or (first and rest.part != part)
                if not same or not step.takes(rest) or left < step.enough:
                    break
                place, part, first = place + 1, rest.part, False
                left -= step.seconds
        return place

    def missed(self, rests: Sequence[Rest]) -> str | None:
        """Why the last rest does not count for the step that it was made for, in words; `None` where it counts, or no
        step is left."""
        if not rests:
            return None
        place, rest = self.done(rests[:-1]), rests[-1]
        if place == len(self.steps) or self.done(rests) > place:
            return None
        step = self.steps[place]
        said = f"does not count for step {place + 1}"
        if not step.takes(rest):
            return f"{said}: {np.degrees(step.off(rest)):.0f}° off its direction"
        if rest.time[1] - rest.time[0] < step.enough:
            return f"{said}: shorter than {step.enough:.0f} s"
        return f"{said}: the log shows no time without power before it"

    def finished(self, rests: Sequence[Rest]) -> bool:
        """Whether nothing is left to be done; turns are not seen, so that a run with some ends with its input."""
        return self.done(rests) == len(self.steps) and not self.then

    def next_position(self, rests: Sequence[Rest]) -> NextPosition | None:
        """The next step; its gain is the share of the run that it is."""
        place, share = self.done(rests), 1.0 / len(self.steps)
        if place < len(self.steps):
            step = self.steps[place]
            said = f"step {place + 1} of {len(self.steps)}: {step.statement}"
            return NextPosition(step.up, said, share, step.temperature)
        if not self.then:
            return None
        words = "; ".join(said for said, _ in self.then)
        return NextPosition(
            self.steps[-1].up, f"{words}; then end the input", share, None, self.then[0][1]
        )
