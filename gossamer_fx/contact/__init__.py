"""Contact of films, cables, beams and solids: pairs, search, motion check, and the scene's item."""
