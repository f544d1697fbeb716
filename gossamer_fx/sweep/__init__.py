"""Many runs of one model: values in orthogonal arrays, processes that share the runs, signal-to-noise ratios."""
