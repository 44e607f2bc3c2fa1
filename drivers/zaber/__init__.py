"""Stages of Zaber's devices with the ASCII protocol."""
