"""BRDF models, atoms and the dictionaries made of them."""
