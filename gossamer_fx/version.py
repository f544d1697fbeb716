"""Which gossamer_fx this is."""

VERSION = "1.0.0.dev0"
