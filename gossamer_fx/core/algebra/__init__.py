"""The numbering of all unknowns, and what is fetched from them."""
