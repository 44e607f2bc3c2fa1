"""`halfangle bench --real`: captures and materials that nobody here made."""
