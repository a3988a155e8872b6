"""What is fitted, and why."""
