"""Which gossamer_fx this is."""

VERSION = "0.1.0"
