"""Gas: zero-dimensional chambers, connected by openings, coupled to films by pressure and volume."""
