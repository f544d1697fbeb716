"""Figures of real films and gases, each with its source; optics of surfaces are in `gossamer_fx.orbit.optics`."""
