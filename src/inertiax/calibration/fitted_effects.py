"""Named effects beside a calibration's own parameters: what is stored of each, and its JSON form."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from .._records import field, Module
from .._typing import AnyArray
from ..effects import CATALOGUE, Effect
from ..effects.forms import check_settings, num_coefficients
from ..physics.leaves import as_leaf
from .labels import pair, Settings


class FittedEffect(Module):
    """One effect of the catalogue with its fitted coefficients.

    It adds $\\sum_q c_q S_{iq}$ to the outputs of each of its channels i, with S the effect's `shape` under
    these settings. Where a shape is scaled by the recordings it is fitted on, their extent is kept. Settings and
    unit of each effect stand in the reference of effects, and as `settings` and `unit` of the members of
    `effects.CATALOGUE`.

    Raises `ValueError` for another triad, channels that are none, sizes that do not fit each other, and settings and a
    unit that are not the effect's. A name that the catalogue lacks is one of a user's own catalogue.
    """

    name: str = field(static=True)  # of the catalogue
    triad: str = field(static=True)  # accel or gyro
    channels: tuple[int, ...] = field(static=True)  # 0, 1, 2 for x, y, z
    # Such as a time constant, s.
    settings: tuple[tuple[str, float | int | str], ...] = field(converter=Settings)
    coefficients: Float[AnyArray, " column"]  # in `unit`
    covariance: Float[AnyArray, "column column"]  # in `unit` squared
    # SI, of the coefficients; of the first, where a form mixes units (`Effect.unit`).
    unit: str = field(static=True)
    clock: tuple[float, float] | None = field(converter=pair, default=None)  # s, start and end
    temperature: tuple[float, float] | None = field(converter=pair, default=None)  # °C
    greatest_input: float = field(converter=as_leaf, default=0.0)  # g or rad/s
    # The model that it was fitted beside: its degree, and the temperatures (°C) at ±1 of its polynomials.
    degree: int | None = field(static=True, default=None)
    # °C at −1 and +1 of its polynomials.
    scale: tuple[float, float] | None = field(converter=pair, default=None)

    def __check_init__(self):
        if self.triad not in ("accel", "gyro"):
            raise ValueError(
                f"`FittedEffect(triad=...)`: {self.triad!r} is neither 'accel' nor 'gyro'."
            )
        if not self.channels or not set(self.channels) <= {0, 1, 2}:
            raise ValueError(
                f"`FittedEffect(channels=...)`: {self.channels}; they are 0, 1, 2 for x, y, z."
            )
        count = np.shape(self.coefficients)[-1:]
        if count == () or np.shape(self.covariance)[-2:] != (*count, *count):
            raise ValueError(
                f"`FittedEffect(covariance=...)`: shape {np.shape(self.covariance)} beside coefficients of shape "
                f"{np.shape(self.coefficients)}; n coefficients have (n, n)."
            )
        for effect in CATALOGUE:  # one of a user's own catalogue is in none of these
            if effect.name == self.name:
                where = f"`FittedEffect({self.name!r}, ...)`"
                settings = dict(self.settings)
                _check_form(effect, self.triad, settings, self.unit, where)
                check_settings(effect, self.triad, settings, where)
                needed = num_coefficients(effect, self.triad, settings, self.degree)
                if needed and count[0] not in needed:
                    raise ValueError(
                        f"{where}: {count[0]} coefficients; in this form the effect has "
                        f"{' or '.join(map(str, needed))}."
                    )

    @property
    def plain_settings(self) -> dict[str, float | int | str]:
        """The settings as Python's numbers and text."""
        return {k: v if isinstance(v, (str, int)) else float(v) for k, v in self.settings}

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Such as `accel_y`."""
        return tuple(f"{self.triad}_{'xyz'[c]}" for c in self.channels)


class Extent(msgspec.Struct, forbid_unknown_fields=True):
    """What the recordings covered that an effect was fitted on."""

    clock: tuple[float, float] | None
    temperature: tuple[float, float] | None
    greatest_input: float
    degree: int | None
    scale: tuple[float, float] | None


class EffectEntry(msgspec.Struct, forbid_unknown_fields=True):
    """One entry of `effects` in calibration.json."""

    name: str  # of the catalogue
    channels: list[str]  # such as accel_y
    settings: dict[str, float | int | str]  # such as a time constant, s
    coefficients: list[float]  # in `unit`
    covariance: list[list[float]]  # in `unit` squared
    unit: str  # SI
    fitted_on: Extent  # extent of the recordings that it was fitted on


def to_entry(effect: FittedEffect) -> EffectEntry:
    """The JSON form of a fitted effect."""
    return EffectEntry(
        name=effect.name,
        channels=list(effect.channel_names),
        settings=effect.plain_settings,
        coefficients=np.asarray(effect.coefficients).tolist(),
        covariance=np.asarray(effect.covariance).tolist(),
        unit=effect.unit,
        fitted_on=Extent(
            _plain(effect.clock), _plain(effect.temperature), float(effect.greatest_input), effect.degree,
            _plain(effect.scale),
        ),
    )  # fmt: skip


def _plain(values: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def from_entry(
    entry: EffectEntry, where: str, catalogue: Sequence[Effect] = CATALOGUE
) -> FittedEffect:
    """The fitted effect of a JSON entry.

    Raises `ValueError`, one line beginning with `where`, for an effect that `catalogue` lacks or for
    settings, channels, unit or shapes that are not that effect's.
    """
    where = f"{where}: effect {entry.name!r}"
    effect = known_effect(entry.name, where, catalogue)
    triad, channels = _channels(entry.channels, where)
    unit = _check_form(effect, triad, entry.settings, entry.unit, where)
    count = len(entry.coefficients)
    if (
        count == 0
        or len(entry.covariance) != count
        or any(len(r) != count for r in entry.covariance)
    ):
        raise ValueError(
            f"{where}: {count} coefficients need a covariance of {count} rows of {count} numbers."
        )
    extent = entry.fitted_on
    return FittedEffect(
        entry.name, triad, channels, tuple(sorted(entry.settings.items())),
        np.asarray(entry.coefficients, float), np.asarray(entry.covariance, float), unit,
        extent.clock, extent.temperature, extent.greatest_input, extent.degree, extent.scale,
    )  # fmt: skip


def _check_form(
    effect: Effect, triad: str, settings: Mapping[str, Any], unit: str, where: str
) -> str:
    """The unit of an effect's form. Raises `ValueError` for another triad, other settings and another unit."""
    if triad not in effect.triads:
        raise ValueError(f"{where}: is one of {' and '.join(effect.triads)}, not of {triad}.")
    known = effect.settings
    if not {k for k, needed in known.items() if needed} <= set(settings) <= set(known):
        raise ValueError(f"{where}: settings are {sorted(settings)} but must be {sorted(known)}.")
    right = effect.unit(triad, settings)
    # Files written before forms had units of their own name that of the form on the bias; the numbers are the same.
    if unit not in (right, effect.units[triad]):
        raise ValueError(f"{where}: unit is {unit!r}; it must be {right!r}.")
    return right


def known_effect(name: str, where: str, catalogue: Sequence[Effect] = CATALOGUE) -> Effect:
    """The effect of that name. Raises `ValueError` naming those that the catalogue has."""
    found = next((e for e in catalogue if e.name == name), None)
    if found is None:
        names = ", ".join(e.name for e in catalogue)
        raise ValueError(f"{where}: is not in the catalogue; it has {names}.")
    return found


def _channels(names: Sequence[str], where: str) -> tuple[str, tuple[int, ...]]:
    valid = {f"{t}_{a}": (t, i) for t in ("accel", "gyro") for i, a in enumerate("xyz")}
    triads = {valid[n][0] for n in names if n in valid}
    if any(n not in valid for n in names) or len(set(names)) != len(names) or len(triads) != 1:
        raise ValueError(
            f"{where}: channels are {list(names)} but must be different ones of one triad, such as "
            f"'accel_x'."
        )
    return triads.pop(), tuple(valid[n][1] for n in names)
