"""The model that was judged: one description, the same in calibrate, diagnose, design, fleet and reports."""

import msgspec

from ..data.recording import ModelChoice


# °C; over less, parameters are constants, and one pose tells nothing of an accelerometer
LEAST_SPAN = 1.0


class TriadSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is estimated of one triad."""

    estimator: str  # a name of `[model] accel_estimator` or `gyro_estimator`
    temperature_degree: int  # of every parameter's polynomial; 0 = constant
    parameters: tuple[str, ...]  # at one temperature, in order
    g_sensitivity: bool  # whether D is estimated


class ModelSpec(msgspec.Struct, frozen=True):
    """What is estimated of a device, and who chose it."""

    accel: TriadSpec | None  # None: not calibrated
    gyro: TriadSpec | None  # None: not calibrated
    together: bool = False  # both triads in one least squares
    lever_arms: bool = False  # of the accelerometers
    misalignment: bool = True  # of the gyros to the accelerometers; False holds it at zero
    chosen_by: tuple[tuple[str, str], ...] = ()  # (what, "user" or "tool")

    def document(self) -> dict:
        """The `model` block of every JSON result."""
        return msgspec.json.decode(msgspec.json.encode(to_model_entry(self)))


class ModelEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The `model` block as it is read back."""

    accel: TriadSpec | None
    gyro: TriadSpec | None
    together: bool
    lever_arms: bool
    misalignment: bool
    chosen_by: dict[str, str]

    def spec(self) -> ModelSpec:
        """The block as a `ModelSpec`."""
        chosen_by = tuple(self.chosen_by.items())
        return ModelSpec(
            self.accel, self.gyro, self.together, self.lever_arms, self.misalignment, chosen_by
        )


def to_model_entry(spec: ModelSpec) -> ModelEntry:
    """A `ModelSpec` as it is written."""
    return ModelEntry(
        spec.accel,
        spec.gyro,
        spec.together,
        spec.lever_arms,
        spec.misalignment,
        dict(spec.chosen_by),
    )


def describe(
    asked: ModelChoice,
    accel: TriadSpec | None,
    gyro: TriadSpec | None,
    *,
    together: bool = False,
    lever_arms: bool = False,
    misalignment: bool = True,
) -> ModelSpec:
    """The model that was fitted, with who chose each part of it: "user" where `[model]` named it."""
    by = lambda value: "tool" if value is None else "user"
    chosen_by: dict[str, str] = {}
    for name, triad in (("accel", accel), ("gyro", gyro)):
        if triad is not None:
            said = getattr(asked, f"{name}_estimator")
            # An estimator that was asked for and could not be used was replaced by the tool.
            chosen_by[f"{name}.estimator"] = "user" if said == triad.estimator else "tool"
            chosen_by[f"{name}.temperature_degree"] = by(asked.temperature_degree)
    if gyro is not None:
        chosen_by["gyro.g_sensitivity"] = by(asked.g_sensitivity)
    for name in ("together", "lever_arms", "misalignment"):
        chosen_by[name] = by(getattr(asked, name))
    return ModelSpec(
        accel, gyro, together, lever_arms, misalignment, tuple(sorted(chosen_by.items()))
    )
