"""A scene: what there is.  `compile` turns it into a `System`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.model.ports import starting_from
from gossamer_fx.model.scalar_unknowns import InitialCondition, ScalarUnknownsMaker
from gossamer_fx.model.terms import Body, Term, is_body
from gossamer_fx.scene.initial import start_coordinates
from gossamer_fx.scene.validation import validate
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import PathAverage, StressRule

DOES = ("terms", "block", "initialise", "border")


@runtime_checkable
class Item(Protocol):
    """Anything a scene may be made of: it has a name, and may have any of the other attributes.

    `requires()`   items that it refers to (they join the scene by themselves)
    `terms()`      its roles
    `block`        coordinates, if it is a body
    `initialise()` a change of the initial state of the whole scene
    `border`       the class that compiles all items of its kind to a `ScalarUnknowns`, if it brings scalar unknowns
    """

    name: str


@check_arguments
class Scene:
    """The items of a scene and, through them, all that they refer to.

    Raises:
        InputError: no items, something that is no item, two items of one name.
    """

    def __init__(self, *items: Item) -> None:
        self.items: list[Item] = []
        for item in items:
            self._add(item)
        check(bool(self.items), "The scene is empty; give it a body or a chamber.")
        names = [item.name for item in self.items]
        twice = sorted({n for n in names if names.count(n) > 1})
        check(
            not twice,
            f"Two parts of the scene are called '{twice[0] if twice else ''}'; give each its own name.",
        )

    def _add(self, item: Item) -> None:
        check(
            isinstance(item, Item),
            f"{item!r} is no part of a scene; give bodies, gas parts, loads or interactions.",
        )
        check(
            any(hasattr(item, what) for what in DOES),
            f"'{item.name}' ({type(item).__name__}) has none of {', '.join(DOES)}, so it would do nothing in a scene; "
            "give it one of them, or leave it out.",
        )
        if any(item is known for known in self.items):
            return
        for other in getattr(item, "requires", tuple)():
            self._add(other)
        self.items.append(item)

    @property
    def bodies(self) -> list[Body]:
        """Bodies of the scene, those that parts ask for included."""
        return [item for item in self.items if is_body(item)]

    @property
    def comm(self) -> MPI.Intracomm:
        """That of the bodies; a scene without bodies is computed on every rank alike."""
        return self.bodies[0].comm if self.bodies else MPI.COMM_WORLD

    def terms(self) -> Iterable[Term]:
        for item in self.items:
            yield from getattr(item, "terms", tuple)()

    def compile(self, rule: StressRule | None = None) -> System:
        """Number the unknowns, compile the forms, take the initial state.

        Raises:
            InputError: cells without size, initial data that are not finite, or what a part finds wrong with its
                surroundings.
        """
        validate(self.items, self.comm)
        for body in self.bodies:
            for what, values in zip(
                ("displacement", "velocity"), body.initial_state(), strict=True
            ):
                check_on_all(
                    self.comm,
                    bool(np.isfinite(values).all()),
                    f"The initial {what} of '{body.name}' is not finite everywhere; check the function that gives it.",
                )
        conditions = [item for item in self.items if isinstance(item, InitialCondition)]
        starts = start_coordinates(self.bodies, conditions, self.comm)
        with starting_from(
            {id(body): values for body, values in zip(self.bodies, starts, strict=False)}
        ):
            terms = list(self.terms())
        system = System(self.bodies, terms, rule or PathAverage(), self.comm)
        system.starts = starts
        makers: dict[ScalarUnknownsMaker, list[Item]] = {}
        for item in self.items:
            if hasattr(item, "border"):
                makers.setdefault(item.border, []).append(item)
        for maker, group in makers.items():
            system.borders.append(maker(group, system))
        system.start(conditions)
        return system
