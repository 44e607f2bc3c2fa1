"""The `halfangle` command: no logic of its own."""
