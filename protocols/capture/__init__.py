"""The engine: runs a plan on a rig into a session."""
