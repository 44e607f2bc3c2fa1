"""Sessions in a folder, and what can be done with them next."""
