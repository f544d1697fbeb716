"""The items of a scene, and the terms that they add to the equations of motion."""
