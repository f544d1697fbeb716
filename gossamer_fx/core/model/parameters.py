"""Parameters of terms: the numbers and fields by which results of a scene may be derived.

A term names the parameters of its item.  Where the equations are UFL forms, a parameter is a
coefficient of these forms, and UFL takes the derivative.  Elsewhere it is a number that the
compiled kind of the term knows by a key (`Differentiable.get_number`).
"""

from __future__ import annotations

from dataclasses import dataclass

from dolfinx import fem

# A constant or a function of forms, or the key of a number of a compiled kind.
Source = fem.Constant | fem.Function | str


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number, vector or field of a term.

    Attributes:
        name: as the item of the scene calls it, e.g. "thickness".
        unit: SI unit; empty for a pure number.
        source: the coefficient of the forms, or the key of the number.
        entry: position in the item's list of such numbers; None if the item has one number.
    """

    name: str
    unit: str
    source: Source
    entry: int | None = None
