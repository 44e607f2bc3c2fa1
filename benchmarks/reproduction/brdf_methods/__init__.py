"""Ways to a whole BRDF from few samples of it or with few parameters, one a file."""
