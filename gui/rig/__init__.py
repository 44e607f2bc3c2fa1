"""The devices of the rig in the window."""
