"""What is done at one pose: shots, brackets, darks, checks."""
