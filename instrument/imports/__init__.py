"""Pictures from elsewhere as sessions, and sessions as pictures."""
