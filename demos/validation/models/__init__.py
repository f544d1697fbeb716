"""Models of validation: each predicts the quantities of one kind of experiment from its inputs."""
