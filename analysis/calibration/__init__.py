"""From a session to its calibration and its registered stack."""
