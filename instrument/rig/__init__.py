"""The rig: its devices, opened and left safely."""
