"""The fabric of the square airbag, the same for all programs."""

# A balanced plain weave: as stiff as the isotropic film along its yarns, and soft in shear [Pa].
# Balanced, so that a quarter of the airbag has planes of symmetry with the yarns along the edges
# and along the diagonals.
MODULI = {"E1": 588e6, "E2": 588e6, "nu12": 0.2, "G12": 20e6}
