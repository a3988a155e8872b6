"""Whether `[model]` leaves a sensor to be calibrated."""

from ..data.recording import Campaign, NOT_CALIBRATED
from ..model_selection.select_model import ChosenModel
from .magnetometers_of_device import has_magnetometers


def require_something(campaign: Campaign, chosen: ChosenModel) -> None:
    """Raises `ValueError` where no sensor is left to be calibrated."""
    if chosen.accel_estimator or chosen.gyro_estimator or has_magnetometers(campaign):
        return
    where = "[model]" if campaign.path is None else f"{campaign.path}: [model]"
    asked = [
        k
        for k in ("accel", "gyro", "mag")
        if getattr(campaign.model, f"{k}_estimator") == NOT_CALIBRATED
    ]
    keys = " and ".join(f'{k}_estimator = "{NOT_CALIBRATED}"' for k in asked)
    raise ValueError(
        f"{where} {keys}: nothing is left to calibrate; take out that of the triad to be calibrated."
    )
