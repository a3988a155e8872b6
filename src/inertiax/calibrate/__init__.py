"""From a campaign to calibrations."""
