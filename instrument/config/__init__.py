"""Rig and protocol files in TOML."""
