"""A result in the window: maps, points, relighting."""
