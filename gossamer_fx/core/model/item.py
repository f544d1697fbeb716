"""What a scene is made of: the base class of all its items.

An item overrides what it does; what else it may be is a further base class:

    `Body`                  brings coordinates
    `InitialCondition`      changes the state in which the whole scene starts
    `BringsScalarUnknowns`  brings scalar unknowns, such as gas pressures
    `Sampled`               looks at the state of a run between steps
    `Group`                 brings others under one name

Nothing is asked of a class because of the names of its methods.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class Item:
    """Anything that a scene may be made of.

    Attributes:
        name: of the item in messages, outputs and checkpoints.
    """

    name: str

    def requires(self) -> Iterable[Item]:
        """The items that it refers to; they join the scene by themselves, before it."""
        return ()

    # Any: the state knows bodies, which are items.
    def terms(self, start: Any) -> Iterable[Any]:
        """What it adds to the equations of a scene that begins in a `State`: each a `Term`."""
        return ()

    def warnings(self, items: Iterable[Item]) -> Iterable[str]:
        """What of it is unusual in a scene of these items: sentences that are printed once before
        the scene is computed.  Collective."""
        return ()


class Group(Item):
    """Items under one name, which `requires` returns; it adds nothing itself."""
