"""The light: its place, powers and fall-off."""
