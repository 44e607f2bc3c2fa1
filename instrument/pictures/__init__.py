"""Pictures from elsewhere: reads them, and writes a session of them."""
