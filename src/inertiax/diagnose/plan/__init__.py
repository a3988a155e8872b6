"""What a plan can show, before any output is explained."""
