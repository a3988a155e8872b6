"""What each candidate effect would do to the rows."""
