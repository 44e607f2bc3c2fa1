"""Protocols: frozen plans and the engine that carries them out."""
