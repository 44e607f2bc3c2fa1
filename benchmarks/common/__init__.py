"""Scenes with their truth, and methods behind one interface."""
