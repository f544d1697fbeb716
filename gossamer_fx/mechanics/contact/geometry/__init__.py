"""What can touch: surfaces of bodies and obstacles, their points, and the filter of parts that are
connected."""
