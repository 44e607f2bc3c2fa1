"""Scenes: maps on a plane or a mesh of true size, in the formats of other programs."""
