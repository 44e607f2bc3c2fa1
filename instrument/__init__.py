"""The instrument: rig, configuration, session files."""
