"""Commands that measure, for anyone to run."""
