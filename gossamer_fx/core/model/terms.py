"""The terms that the items of a scene add to its equations.

A *term* plays one of five roles:

    kinetic energy   a constant mass matrix
    stored energy    ψ(e(q)) of a measure e that rigid motions leave as it is, and a density ψ
    dissipation      a stress against the rate of a measure
    load             a force whose work counts as supplied
    constraint       coordinates that are fixed, or measures that stay zero

The general kinds of terms are in `mechanics/terms`; a kind with one user lies in the folder of its
user.  Each kind names the class that compiles all terms of the kind in a scene, see
`terms.assembly`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from dolfinx import fem

from gossamer_fx.core.model.body import Body
from gossamer_fx.core.model.item import Item


class Term(Protocol):
    """Something that adds to the equations; `compiler` compiles all terms of its kind in a scene at
    once."""

    compiler: ClassVar[type]


class MeasuresMesh(Item, ABC):
    """Base of items whose numbers are measured on the meshes of their bodies when they are made,
    such as the lengths of a tape: a result has no derivative by the shape of these bodies.

    Attributes:
        without_mesh: what to do to have one, for messages.
    """

    without_mesh: ClassVar[str] = "leave it out of the scene"

    @abstractmethod
    def requires(self) -> Iterable[Item]:
        """The bodies that are measured."""

    def depends_on_mesh(self, terms: Sequence[Term], t: float) -> bool:
        """Whether the terms that it has in a scene have numbers at a time t [s] that other meshes
        would change.  Collective."""
        return True


class MeasuresStart(Item, ABC):
    """Base of items that keep what they have measured on bodies in the initial state, such as the
    length of a link: a result has no derivative by the initial positions of these bodies, as others
    would give other items."""

    @abstractmethod
    def requires(self) -> Iterable[Item]:
        """The bodies that are measured, or may be."""

    def keeps_measures(self) -> bool:
        """Whether it has such numbers as it was made."""
        return True


class OnBody(Item):
    """An item of a scene that acts on one body, which joins the scene with it."""

    body: Body

    def requires(self) -> Iterable[Item]:
        yield self.body


# ---- parameters ----------------------------------------------------------------------------------

# A term names the parameters of its item, with respect to which results of a scene may be
# differentiated.  Where the equations are UFL forms, a parameter is a coefficient of these forms,
# and UFL takes the derivative.  Elsewhere it is a number that the compiled kind of the term knows
# by a key (`Differentiable.get_number`).

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
        changes_mass: whether masses of points depend on it, by which a run has no derivative.
    """

    name: str
    unit: str
    source: Source
    entry: int | None = None
    changes_mass: bool = False
