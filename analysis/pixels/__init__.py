"""Normal and BRDF of single pixels."""
