"""Feedback: torques that follow from the motion, booked as supplied."""
