"""What in a recording looks wrong before any fit."""
