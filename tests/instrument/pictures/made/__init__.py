"""Picture files with random, valid headers, by writers that know which light each of them means."""
