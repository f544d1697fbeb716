"""Many cases of one problem: what is missing is computed, failures have names, tables, pictures."""
