"""The model that was fitted, as results and files hold it."""

from ..data.recording import Campaign
from ..model_selection.model_spec import describe, ModelSpec, TriadSpec
from ..model_selection.select_model import ChosenModel
from .results import TriadResult


def described_model(
    campaign: Campaign,
    chosen: ChosenModel,
    accel: TriadResult | None,
    gyro: TriadResult | None,
    model: ModelSpec | None,
) -> ModelSpec:
    """The model that was fitted."""
    if model is not None:
        return model

    def triad(result: TriadResult | None, name: str | None) -> TriadSpec | None:
        if result is None or name is None:
            return None
        names = result.estimator.names
        by_force = any("g_sensitivity" in n for n in names)
        return TriadSpec(name, result.solution.curve.basis.size - 1, names, by_force)

    return describe(
        campaign.model,
        triad(accel, chosen.accel_estimator),
        triad(gyro, chosen.gyro_estimator),
        together=chosen.together,
        lever_arms=chosen.lever_arms,
        misalignment=chosen.misalignment,
    )
