"""Stages driven by GRBL 1.1: turntable and tilt, or any goniometer."""
