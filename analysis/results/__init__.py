"""The result of a reconstruction: value, file, maps and points."""
