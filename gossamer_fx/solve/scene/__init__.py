"""What there is: a scene, its initial state, and its validation."""
