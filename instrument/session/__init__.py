"""The session file: layout, writing, reading."""
