"""The engine of studies: cases, declared orders, tables and pictures."""
