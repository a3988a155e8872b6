"""Many devices' dwells side by side, and in words why a device has none.

Devices with about as many dwells share one array, padded to one length, so that nothing further on is done
device by device.
"""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Int

from ...data.recorded import Recorded
from ...reduction.dwells import Dwells
from .stacked_dwells import shared_length, stack_dwells


class Reduced(eqx.Module):
    """One device's dwells, or in words why there are none."""

    device: str = eqx.field(static=True)
    dwells: Dwells | None
    reason: str = eqx.field(static=True, default="")
    recorded: Recorded | None = eqx.field(static=True, default=None)  # `None`: not kept


class Stack(eqx.Module):
    """Devices with the same columns and about as many dwells."""

    members: Int[np.ndarray, " devices"]  # their numbers in the reduction
    counts: Int[np.ndarray, " devices"]  # dwells; what follows only pads
    dwells: Dwells  # leads with the device

    def without(self, numbers: Int[np.ndarray, " some"]) -> "Stack":
        """The devices that are not among some."""
        left = ~np.isin(self.members, numbers)
        if left.all():
            return self
        return Stack(
            self.members[left],
            self.counts[left],
            jax.tree.map(lambda x: np.asarray(x)[left], self.dwells),
        )


class Reduction(eqx.Module):
    """Devices in order; each is in one stack, or has a reason. Iterates over `Reduced`, one by one."""

    devices: tuple[str, ...] = eqx.field(static=True)
    reasons: tuple[str, ...] = eqx.field(static=True)  # empty where there are dwells
    stacks: tuple[Stack, ...]
    # By the devices' numbers, of those where it is kept.
    recorded: dict[int, Recorded] = eqx.field(static=True, default_factory=dict)

    @classmethod
    def of(cls, reduced: Sequence[Reduced]) -> "Reduction":
        """Devices that were reduced one by one."""
        groups: dict[tuple[int, object], list[tuple[int, Dwells]]] = {}
        for k, r in enumerate(reduced):
            if r.dwells is not None:
                shape = shared_length(r.dwells.num_dwells), jax.tree.structure(r.dwells)
                groups.setdefault(shape, []).append((k, r.dwells))
        stacks = tuple(
            Stack(
                np.array([k for k, _ in mine]),
                np.array([d.num_dwells for _, d in mine]),
                stack_dwells([d for _, d in mine], length),
            )
            for (length, _), mine in groups.items()
        )
        known = {k: r.recorded for k, r in enumerate(reduced) if r.recorded is not None}
        devices, reasons = (tuple(getattr(r, n) for r in reduced) for n in ("device", "reason"))
        return cls(devices, reasons, stacks, known)

    def with_reduced(
        self, numbers: Int[np.ndarray, " some"], reduced: Sequence[Reduced]
    ) -> "Reduction":
        """The same with some devices, by number, reduced otherwise."""
        again = Reduction.of(reduced)
        reasons = list(self.reasons)
        for k, one in zip(numbers.tolist(), reduced, strict=True):
            reasons[k] = one.reason
        kept = [s.without(numbers) for s in self.stacks]
        moved = [Stack(numbers[s.members], s.counts, s.dwells) for s in again.stacks]
        stacks = tuple(s for s in (*kept, *moved) if len(s.members))
        known = self.recorded | {int(numbers[k]): r for k, r in again.recorded.items()}
        return Reduction(self.devices, tuple(reasons), stacks, known)

    def __iter__(self) -> Iterator[Reduced]:
        place = {int(k): (s, row) for s in self.stacks for row, k in enumerate(s.members)}
        for k, (device, reason) in enumerate(zip(self.devices, self.reasons, strict=True)):
            if k not in place:
                yield Reduced(device, None, reason)
                continue
            stack, row = place[k]
            count = int(stack.counts[row])
            cut = lambda x, r=row, n=count: np.asarray(x)[r, :n]
            yield Reduced(device, jax.tree.map(cut, stack.dwells))
