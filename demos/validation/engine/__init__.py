"""The engine of validation: cases as data files, comparison with measurements, results, report."""
