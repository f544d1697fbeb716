"""Energy densities of films and tapes."""
