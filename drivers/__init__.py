"""Drivers: one Protocol a device kind, one file a device family."""
