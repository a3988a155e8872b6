"""The rows that a diagnosis judges, and what the device went through."""
