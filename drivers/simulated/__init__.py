"""Simulated devices: twins that share one world and one clock."""
