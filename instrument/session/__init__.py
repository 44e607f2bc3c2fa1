"""The session file: its layout, its records, reading it."""
