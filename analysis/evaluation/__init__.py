"""How good a result is: against a truth, and on views held out."""
