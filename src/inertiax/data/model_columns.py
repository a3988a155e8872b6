"""Whether the recordings have the columns that `[model]` asks for."""

from .recording import ModelChoice, Recording


def check_model_columns(model: ModelChoice, recordings: tuple[Recording, ...]) -> None:
    """Raise `ValueError` where `[model]` asks for columns that no recording has."""
    needs = (
        (model.accel_estimator is not None, "accel_estimator", model.accel_estimator, "accel"),
        (model.accel_estimator == "reference", "accel_estimator", "reference", "reference_accel"),
        (model.gyro_estimator is not None, "gyro_estimator", model.gyro_estimator, "gyro"),
        (model.gyro_estimator == "reference", "gyro_estimator", "reference", "reference_gyro"),
        (model.gyro_estimator == "gravity", "gyro_estimator", "gravity", "accel"),
        (model.g_sensitivity is True, "g_sensitivity", True, "gyro"),
        (
            bool(model.temperature_degree),
            "temperature_degree",
            model.temperature_degree,
            "temperature",
        ),
    )
    for asked, key, value, column in needs:
        if asked and all(getattr(r, column) is None for r in recordings):
            columns = column if column == "temperature" else f"{column}_x/y/z"
            said = str(value).lower() if isinstance(value, bool) else repr(value)
            raise ValueError(
                f"[model] {key} = {said} needs the column(s) {columns}, which no recording has; map "
                f"them under [columns] or change {key}."
            )
    force = any(r.accel is not None or r.reference_accel is not None for r in recordings)
    if model.g_sensitivity and not force:
        raise ValueError(
            "[model] g_sensitivity = true needs the specific force, accel_x/y/z or "
            "reference_accel_x/y/z, which no recording has; set it to false."
        )
