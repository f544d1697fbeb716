"""A scene: what there is.  `compile` turns it into a `System`."""

from __future__ import annotations

from typing import Protocol, cast, runtime_checkable

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.model.state import InitialState
from gossamer_fx.model.terms import Body, BringsTerms, RefersToItems, is_body
from gossamer_fx.scene.validation import validate
from gossamer_fx.system.system import System
from gossamer_fx.terms.assembly import Part
from gossamer_fx.terms.discrete_gradient import PathAverage, StressRule
from gossamer_fx.terms.scalar_unknowns import InitialCondition, ScalarUnknownsMaker

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
        if isinstance(item, RefersToItems):
            for other in item.requires():
                self._add(cast(Item, other))
        self.items.append(item)

    @property
    def bodies(self) -> list[Body]:
        """Bodies of the scene, those that parts ask for included."""
        return [item for item in self.items if is_body(item)]

    @property
    def comm(self) -> MPI.Intracomm:
        """That of the bodies; a scene without bodies is computed on every rank alike."""
        return self.bodies[0].comm if self.bodies else MPI.COMM_WORLD

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
        start = InitialState(self.bodies, self.comm)
        for item in self.items:
            if isinstance(item, InitialCondition):
                item.initialise(start)
        parts = [
            Part(item, list(item.terms(start)))
            for item in self.items
            if isinstance(item, BringsTerms)
        ]
        system = System(start, parts, rule or PathAverage())
        makers: dict[ScalarUnknownsMaker, list[Item]] = {}
        for item in self.items:
            if hasattr(item, "border"):
                makers.setdefault(item.border, []).append(item)
        for maker, group in makers.items():
            system.scalar_unknowns.append(maker(group, system))
        system.initialise()
        return system
