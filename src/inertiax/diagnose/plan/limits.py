"""What a plan can tell and what it cannot: the outcome of an audit."""

from collections.abc import Sequence

from ..._jax import eqx
from ...model_selection.model_spec import ModelSpec


POWER = 0.9  # chance with which an effect of the stated size is detected


class Detectable(eqx.Module):
    """The smallest size of an effect that the campaign would have shown."""

    name: str = eqx.field(static=True)  # of the catalogue
    channels: tuple[str, ...] = eqx.field(static=True)  # such as accel_y
    size: float = eqx.field(static=True)  # in `unit`
    unit: str = eqx.field(static=True)  # SI
    # Hz, of the lines that it holds for, where it does not for all forms of the effect.
    band: tuple[float, float] | None = eqx.field(static=True, default=None)

    def as_dict(self) -> dict:
        """For scripts; the band where there is one."""
        made: dict = {"name": self.name, "channels": list(self.channels), "size": self.size}
        made["unit"] = self.unit
        return made if self.band is None else {**made, "band": list(self.band)}

    @property
    def whole_name(self) -> str:
        """The name with the band, for people."""
        if self.band is None:
            return self.name
        return f"{self.name} of {self.band[0]:.2g} to {self.band[1]:.2g} Hz"


def smallest(found: Sequence[Detectable]) -> tuple[Detectable, ...]:
    """For each effect, triad and band the channel on which the least of it would have shown."""
    best: dict[tuple, Detectable] = {}
    for d in found:
        key = d.name, d.channels[0].partition("_")[0], d.band
        if key not in best or d.size < best[key].size:
            best[key] = d
    return tuple(best.values())


class Alias(eqx.Module):
    """Two effects on the same channel of which some forms look alike in this plan."""

    channel: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    r_squared: float = eqx.field(static=True)  # of the forms that are most alike
    share: float = eqx.field(static=True)  # part of one's forms that the other mimics, the larger


class AliasSet(eqx.Module):
    """Effects that this plan cannot tell apart, and the experiments that would."""

    names: tuple[str, ...] = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    r_squared: float = eqx.field(static=True)
    experiments: tuple[str, ...] = eqx.field(static=True)


class Absorbed(eqx.Module):
    """An effect that the calibration's own parameters take up in this plan."""

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    by: tuple[str, ...] = eqx.field(static=True)  # parameters, as in calibration.json


class Audit(eqx.Module):
    """What a plan can tell."""

    not_testable: tuple[tuple[str, str], ...] = eqx.field(static=True)  # name and reason
    detectable: tuple[Detectable, ...]
    aliases: tuple[Alias, ...]
    absorbed: tuple[Absorbed, ...] = ()
    unobservable: tuple[str, ...] = eqx.field(static=True, default=())  # of the calibration itself
    sets: tuple[AliasSet, ...] = ()
    model: ModelSpec | None = eqx.field(static=True, default=None)  # that the plan was audited for

    def lines(self) -> tuple[str, ...]:
        """The audit as lines of text."""
        made = [f"not observable: {line}" for line in self.unobservable]
        made += [
            f"absorbed: {a.name} on {', '.join(a.channels)} looks like {', '.join(a.by)}"
            for a in self.absorbed
        ]
        taken = {a.name for a in self.absorbed}
        made += [f"not testable: {n} ({why})" for n, why in self.not_testable if n not in taken]
        made += [
            f"detectable from {d.size:.2g} {d.unit}: {d.whole_name} on {', '.join(d.channels)}"
            for d in self.detectable
        ]
        made += [
            f"not separable on {', '.join(s.channels)}: {', '.join(s.names)} (R² {s.r_squared:.3f}); "
            f"to separate them: {'; or '.join(s.experiments)}"
            for s in self.sets
        ]
        return tuple(made)

    def as_dict(self) -> dict:
        """For scripts; sizes in SI units."""
        return {
            "schema": "inertiax.audit/1",
            "power": POWER,
            "model": None if self.model is None else self.model.document(),
            "unobservable": list(self.unobservable),
            "absorbed": [
                {"name": a.name, "channels": list(a.channels), "by": list(a.by)}
                for a in self.absorbed
            ],
            "not_testable": [{"name": n, "reason": why} for n, why in self.not_testable],
            "detectable": [d.as_dict() for d in self.detectable],
            "sets": [
                {
                    "names": list(s.names),
                    "channels": list(s.channels),
                    "r_squared": s.r_squared,
                    "experiments": list(s.experiments),
                }
                for s in self.sets
            ],
        }
