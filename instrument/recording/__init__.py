"""Writes session files: the tree, then pose by pose."""
