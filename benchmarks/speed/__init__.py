"""How fast single stages are."""
