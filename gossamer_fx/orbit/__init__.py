"""Flight: orbits, gravity of the Earth, Sun and Moon, and the loads of space.  Loaded by scenes that fly only."""
