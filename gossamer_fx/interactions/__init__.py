"""What acts between bodies, through ports, or holds them."""
