"""Fold maps: isometric maps of flat films to folded ones, e.g. `gx.fold.zigzag`; what they know becomes creases.

zigzag   accordion of panels across a strip, a sheet or a tube that is pressed flat
roll     strip or flat tube rolled up, tip inside
miura    Miura's rows of parallelograms
ikaros   n trapezoids, each an accordion, in arms that stand out from a hub or are wound round it
star     ring whose pleats wind round a polygonal hub
spiral   accordion strip wound round a hub
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "ikaros": ("arms", "Arms"),
    "miura": ("parallelograms", "Miura"),
    "roll": ("polyline", "Roll"),
    "spiral": ("wound_strip", "WoundStrip"),
    "star": ("pinwheel", "Pinwheel"),
    "zigzag": ("polyline", "Zigzag"),
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(
            f"gossamer_fx.fold has no '{name}'; its maps are: {', '.join(__all__)}"
        )
    from gossamer_fx.checks.arguments import guarded

    module, thing = _HOME[name]
    found = globals()[name] = guarded(
        getattr(import_module(f"gossamer_fx.fold.{module}"), thing), ()
    )
    return found
