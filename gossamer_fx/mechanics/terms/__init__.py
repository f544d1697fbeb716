"""The kinds of terms, compiled to vectors and matrices."""
