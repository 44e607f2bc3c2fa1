"""Files in general: checked input, text, digests, files from strangers."""
