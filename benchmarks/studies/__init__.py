"""Single questions, answered by a command each."""
