"""Inflatable tubes of compartments, folded or not, with flat or round ends, in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any

import gossamer_fx as gx
from gossamer_fx.extend import (
    FilmLaw,
    Folded,
    Folding,
    Group,
    Property,
    Vector,
    check,
    check_arguments,
    not_negative,
)

Opening = float | Callable[[float], float]


@check_arguments
class InflatableTube(Group):
    """A closed tube of film with gas in compartments: an assembly of film, chambers, passages and
    supports.

    Attributes that were not asked for are None or empty.  In a scene the tube brings all of them.

    Args:
        mesh: of the film, with the groups of `gossamer_fx.meshes.tube.flat_tube`, whose ends are
            flat, or of `gossamer_fx.meshes.round_tube.round_tube`: if there are several
            compartments, "compartment 1" and so on and "ring 1" and so on.
        law: of the film.
        properties: numbers of the law that differ along the tube, see `Membrane`.
        gas: in it, at 293 K at the start.
        pressure: of the gas at the start [Pa].
        dead_volume: of each compartment [m³], see `Chamber`.
        outside: gas outside; default vacuum.
        clamp: group of the mesh that is fixed; None: the tube is free.
        caps: rigid bodies to which ends of the tube are fixed, e.g. a satellite, by the group of
            the end.
        folds: with which the tube starts folded, e.g. `gx.fold.Zigzag` or, of a round tube,
            `gx.fold.TubeZigzag`; default as it is made.
        origin: position of the folded shape [m], see `Folding.start`.
        turn: its rotation vector [rad].
        crease_stiffness: of creases at the fold lines [N m/m/rad]; zero: none.
        set_angle_ratio: rest angle of creases over the angle of their folds, 0 to 1.
        yield_angle: of creases [rad], see `Crease`; None: elastic.
        contact_distance: activation distance of contact of the film with itself [m]; zero: no
            contact.
        contact_stiffness: its stiffness [N/m³]; None: from closing speeds, see `Contact`.
            Gradients of runs need a number.
        name: for messages and outputs; the items have names that begin with it.

    Attributes:
        film: the membrane.
        rings: `Ring` of each passage.
        chambers: one for each compartment, from the inlet.
        passages: orifices as wide as the deformed rings: a tube chokes where it is folded.
        clamp: support of the inlet.
        caps: a `RigidRegion` for each end with a cap.
        start, creases, contact: initial shape, creases and contact.

    Raises:
        InputError: creases without folds, or what the items refuse.
    """

    def __init__(
        self,
        mesh: gx.Mesh,
        law: FilmLaw,
        *,
        gas: gx.IdealGas,
        properties: Mapping[str, Property] | None = None,
        pressure: float = 1.0,
        dead_volume: float = 1e-6,
        outside: gx.gas.Ambient | None = None,
        clamp: str | None = "inlet",
        caps: Mapping[str, gx.RigidBody] | None = None,
        folds: Folding | None = None,
        origin: Vector = (0.0, 0.0, 0.0),
        turn: Vector = (0.0, 0.0, 0.0),
        crease_stiffness: Annotated[float, not_negative("N m/m/rad")] = 0.0,
        set_angle_ratio: float = 1.0,
        yield_angle: float | None = None,
        contact_distance: Annotated[float, not_negative("m")] = 0.0,
        contact_stiffness: float | None = None,
        name: str = "tube",
    ) -> None:
        check(
            crease_stiffness == 0 or folds is not None,
            f"InflatableTube '{name}': creases are at fold lines; give the folds.",
        )
        check(
            contact_stiffness is None or contact_distance > 0,
            f"InflatableTube '{name}': contact_stiffness is given, but there is no contact; give "
            "contact_distance, too.",
        )
        self.name = name
        # Creases are groups of edges, so that the mesh is marked before the film is made.
        if folds is not None and crease_stiffness:
            mesh = folds.mark(mesh)
        self.film = gx.Membrane(mesh, law, properties=properties, name=f"{name} film")
        # A mesh without such groups is one chamber.
        count = sum(1 for group in mesh.groups if group.startswith("compartment ")) or 1
        self.rings = [gx.gas.Ring(self.film, f"ring {i}") for i in range(1, count)]
        self.chambers = [
            gx.Chamber(
                self.film,
                gas=gas,
                pressure=pressure,
                temperature=293.0,
                dead_volume=dead_volume,
                # A single chamber is bounded by the whole film.
                surface=(f"compartment {i + 1}",) if count > 1 else (),
                # Each compartment is closed by the rings at its ends; the first and the last one
                # have one.
                rings=tuple(self.rings[max(i - 1, 0) : i + 1]),
                outside=outside,
                name=f"{name} {i + 1}",
            )
            for i in range(count)
        ]
        # Passages are as wide as the deformed rings, so that they close where the tube is folded.
        self.passages = [
            self._orifice(self.chambers[i], self.chambers[i + 1], ring, f"passage {i + 1}")
            for i, ring in enumerate(self.rings)
        ]
        self.clamp = None if clamp is None else gx.Fixed(self.film, clamp)
        self.start: Folded | None = None
        self.creases: list[gx.connectors.Crease] = []
        if folds is not None:
            self.start = folds.start(self.film, origin, turn)
        if folds is not None and crease_stiffness:
            self.creases += folds.creases(
                self.film,
                stiffness=crease_stiffness,
                set_angle_ratio=set_angle_ratio,
                yield_angle=yield_angle,
            )
        self.caps = [
            gx.RigidRegion(self.film, end, rigid_body=body, name=f"{name} {end} cap")
            for end, body in (caps or {}).items()
        ]
        self.contact: gx.Contact | None = None
        if contact_distance:
            self.contact = gx.Contact(
                self.film,
                distance=contact_distance,
                stiffness=contact_stiffness,
                name=f"{name} contact",
            )

    def inlet(self, source: gx.Tank | gx.gas.Ambient, area: Opening) -> gx.Orifice:
        """The valve from a tank or reservoir into the first compartment, with an opening [m²] that
        is a number or a function of time [s]."""
        return self._orifice(source, self.chambers[0], area, "inlet")

    def _orifice(self, first: Any, second: Any, area: Any, what: str) -> gx.Orifice:
        """An orifice between two volumes, of which the name says what it is."""
        return gx.Orifice(
            first, second, area=area, discharge_coefficient=0.8, name=f"{self.name} {what}"
        )

    def requires(self) -> Iterable[Any]:
        yield from (self.film, *self.chambers, *self.passages)
        yield from (part for part in (self.clamp, self.start, self.contact) if part is not None)
        yield from (*self.caps, *self.creases)
