"""Laws of films whose response is computed in C."""
