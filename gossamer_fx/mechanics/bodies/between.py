"""What joins two sides or acts between them: points or frames of two bodies, or of a body and the
ground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, runtime_checkable

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Attached, Port
from gossamer_fx.mechanics.bodies.frames import Frame, Line


def bodies_of(*sides: Attached | Frame | Line) -> Iterable[Any]:
    """The bodies that a joint refers to."""
    for side in sides:
        vectors = (side.origin, *side.directors) if isinstance(side, Frame | Line) else (side,)
        # Vectors of the ground belong to no body.
        for vector in vectors:
            if isinstance(vector, Port):
                yield vector.body


def check_axis(joint: Any) -> None:
    """Raise `InputError` if the axis of a joint, or of what acts about one, has no length."""
    check(
        any(joint.axis),
        f"{type(joint).__name__} '{joint.name}': axis has no length; give its direction.",
    )


class Between:
    """Two sides, at least one of which moves."""

    a: Attached | Frame
    b: Attached | Frame
    name: str

    def __post_init__(self) -> None:
        """Check the arguments, which the class describes; raises `InputError`."""
        check(
            bool(list(bodies_of(self.a, self.b))),
            f"{type(self).__name__} '{self.name}' joins the ground to itself; give a port of a "
            "body.",
        )

    @property
    def _sides(self) -> tuple[Attached | Frame, Attached | Frame]:
        return self.a, self.b

    def requires(self) -> Iterable[Any]:
        yield from bodies_of(*self._sides)


class FrameJoint(Between):
    """Frames of two bodies, or of one and the ground."""

    a: Frame
    b: Frame

    def __post_init__(self) -> None:
        """Check the two frames `a` and `b`, oriented points of bodies or of the ground, that the
        joint connects.

        Raises:
            InputError: both frames are of the ground, or both are of the same body.
        """
        super().__post_init__()
        a = self.a.origin
        b = self.b.origin
        # The distance of two points of one body follows from its stiffness: a joint would be a
        # support.
        if isinstance(a, Port) and isinstance(b, Port):
            check(
                a.body is not b.body,
                f"{type(self).__name__} '{self.name}' joins '{a.body.name}' to itself; join two "
                "bodies.",
            )


@runtime_checkable
class DrawnAsLines(Protocol):
    """An item of a scene that pictures show as straight lines between points of bodies."""

    name: str

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each line."""
        ...
