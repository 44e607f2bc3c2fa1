"""The experiments of the paper's supplement, one a file; `halfangle reproduce` runs them."""
