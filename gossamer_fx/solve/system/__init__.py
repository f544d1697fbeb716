"""A compiled scene: unknowns, residual, tangent, and the ledger's totals."""
