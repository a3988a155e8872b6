"""Whether `[model]` leaves a sensor to be calibrated."""

from ..data.recording import Campaign, NOT_CALIBRATED
from ..model_selection.select_model import ChosenModel
from .magnetometers_of_device import has_magnetometers


def require_something(campaign: Campaign, chosen: ChosenModel) -> None:
    """Raises `ValueError` where no sensor is left to be calibrated."""
    if chosen.accel_estimator or chosen.gyro_estimator or has_magnetometers(campaign):
        return
    raise nothing_left(campaign, "calibrate")


def nothing_left(campaign: Campaign, to: str) -> ValueError:
    """The error that nothing is left `to` do, with the keys of `[model]` by which that is so."""
    where = "[model]" if campaign.path is None else f"{campaign.path}: [model]"
    keys = [f"{k}_estimator" for k in ("accel", "gyro", "mag")]
    asked = [k for k in keys if getattr(campaign.model, k) == NOT_CALIBRATED]
    said = " and ".join(f'{k} = "{NOT_CALIBRATED}"' for k in asked)
    return ValueError(
        f"{where} {said}: nothing is left to {to}; take out that of the triad to {to}."
    )
