"""`halfangle bench`: error against speed on simulated scenes."""
