"""Plan and capture in the window, with the quick look."""
