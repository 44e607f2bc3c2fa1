"""Results for renderers: maps and scenes in the models that other programs know."""
