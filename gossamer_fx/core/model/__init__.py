"""The contract: bodies, terms of the equations, ports and frames."""
