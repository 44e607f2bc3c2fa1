"""`halfangle reproduce`: the paper's experiments."""
