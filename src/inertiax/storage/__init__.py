"""Files that are whole, folders with one owner, and text of files that does no harm where it is shown."""
