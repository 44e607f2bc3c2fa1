"""Cameras of Luxonis, by their SDK depthai."""
