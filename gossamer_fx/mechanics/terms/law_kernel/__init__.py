"""Laws with several states at quadrature points: responses and the choice of strains, in C."""
