"""Laws: plain Python functions of named numbers, compiled to C with exact derivatives."""
