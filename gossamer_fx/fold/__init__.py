"""Fold maps: isometric maps of flat films to folded ones, e.g. `gx.fold.Zigzag`; what they know becomes creases.

zigzag   accordion of panels across a strip, a sheet or a tube that is pressed flat
roll     strip or flat tube rolled up, tip inside
miura    Miura's rows of parallelograms
ikaros   n trapezoids, each an accordion, in arms that stand out from a hub or are wound round it
star     ring whose pleats wind round a polygonal hub
spiral   accordion strip wound round a hub
"""

from gossamer_fx.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
