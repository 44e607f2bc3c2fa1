"""A calibration in the window."""
