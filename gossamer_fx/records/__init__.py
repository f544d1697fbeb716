"""What looks at a run and writes it down."""
