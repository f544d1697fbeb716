"""Roles of parts, compiled: what assembles vectors and matrices."""
