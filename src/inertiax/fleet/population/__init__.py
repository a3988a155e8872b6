"""What the devices of a line have in common, and how one of them profits."""
