"""Pictures and figures as PNG."""
