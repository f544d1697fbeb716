"""A law whose response is computed by C functions, because UFL cannot write it as one
expression."""

from __future__ import annotations

from dataclasses import dataclass

from gossamer_fx.core.forms.kinematics import Expr


@dataclass(frozen=True, eq=False)
class CLaw:
    """Addresses of the C functions of a law, with the signature that FFCx gives to expressions.

    At p points of a cell they take the strains e0 and e1 (p, m) at the start and at the end of a
    step and k `numbers` of the law (p, k), and as their only constant p.

    Attributes:
        path_average: address of the mean stress along the path from e0 to e1, with its derivative
            by e1 (p, m + m²).
        end_point: address of the stress at e1, with its derivative (p, m + m²).
        density: address of the energy density at e0 (p,).
        numbers: expression (k,) of the numbers of the law, which may differ from point to point.
        owner: what has to exist as long as the functions are called.
    """

    path_average: int
    end_point: int
    density: int
    numbers: Expr
    owner: object
