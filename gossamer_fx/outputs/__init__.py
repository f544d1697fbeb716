"""What is recorded of a run: fields, tables, probes."""
