"""Raw rows of many devices to dwell means."""
