"""Time steppers, and the choice of their steps."""
