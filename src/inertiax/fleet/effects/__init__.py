"""What the model of a line leaves out."""
