"""Rig, protocol and capture files in TOML."""
