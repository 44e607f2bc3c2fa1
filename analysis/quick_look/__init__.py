"""Normals during a capture, from previews and nominal poses."""
