"""What everything else is written in: checks, the contract of terms, forms, meshes, arrays."""
