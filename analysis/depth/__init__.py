"""Depth from normals, and how certain it is."""
