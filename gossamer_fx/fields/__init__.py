"""Fields of a state on the meshes of bodies: strains, stresses, wrinkling states."""
