"""The C functions of contact, and how they are compiled and called."""
