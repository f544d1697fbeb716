"""Fold maps: isometric maps of flat films to folded ones, and the creases that follow from them.

Zigzag   accordion of panels across a strip, a sheet or a tube that is pressed flat
Roll     strip or flat tube rolled up, its end inside
Miura    Miura's rows of parallelograms
Ikaros   n trapezoids, each an accordion, in arms that stand out from a hub or are wound round it
Star     ring whose pleats wind round a polygonal hub
"""

from gossamer_fx.core.checks.lazy_names import lazy_names

# Public names are loaded when they are first used.
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
