"""Serial ports: which devices are there, and talking line by line."""
