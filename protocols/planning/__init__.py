"""What a capture would do, before any light goes on."""
