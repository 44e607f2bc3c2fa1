"""Checks and HTML reports of calibrations and results."""
