"""A scene: what there is, and its initial conditions.  `compile` turns it into a `System`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.drawing import table
from gossamer_fx.core.model.body import Array, Body, MeshBody, Vector
from gossamer_fx.core.model.item import Group, Item
from gossamer_fx.core.model.state import BodyState, InitialCondition, InitialState, Sampled
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.assembly import ItemTerms
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage, StressRule
from gossamer_fx.mechanics.terms.scalar_unknowns import BringsScalarUnknowns, ScalarUnknowns
from gossamer_fx.solve.scene.validation import validate
from gossamer_fx.solve.system.initial_state import initialise, take_shape_history
from gossamer_fx.solve.system.system import System


@check_arguments
@dataclass(frozen=True, eq=False)
class RigidMotion(InitialCondition):
    """Adds a rigid motion to the initial velocities of all bodies: v + Ω × (x - c), and Ω × d for
    directors.

    Args:
        spin: Ω [rad/s].
        velocity: v [m/s].
        centre: c [m].

    Raises:
        InputError: an argument that is not three finite numbers.

    Example:
        >>> spinning = gx.Scene(hub, gx.RigidMotion(spin=(0.0, 0.0, 2.0)))
        >>> run = gx.Simulation(spinning, gx.Midpoint(dt=0.01))
        >>> round(gx.probes.AngularVelocity(hub.frame(), "z")(run), 12)
        2.0
    """

    spin: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    name: str = "rigid motion"
    stage: ClassVar[int] = 3

    def initialise(self, start: InitialState) -> None:
        """Add the motion to the rates of all bodies of the scene."""
        spin = np.asarray(self.spin, dtype=float)
        # v + Ω × (x - c) = Ω × x + (v - Ω × c); directors have the first part only.
        at_origin = np.asarray(self.velocity, dtype=float) - np.cross(spin, self.centre)
        for body in start:
            rates = body.rates() + np.cross(spin, body.coordinates())
            rates[:, 0] += at_origin
            start.set_in_motion(body.body, rates)


@check_arguments
@dataclass(frozen=True, eq=False)
class StartFrom(InitialCondition):
    """Takes the initial positions and directors from another compiled scene of the same bodies.

    The other scene is, for example, that of an equilibrium.  Axes and angles of hinges count from
    the bodies as they were made, and have turned with them.  A reduced film also starts from its
    full one: from the part of that shape which its modes hold.

    Of items that are in both scenes, as the same objects, it also takes pairs in contact with their
    stiffness, rest angles of creases that yield, paid out lengths of braked ropes, largest strains
    of cords, strains of branches that relax or slide, temperatures of films in sunlight and what
    latches hold; of all but contact and latches if both scenes have the same ones.  Gas begins with
    the pressure of its chamber, and time with zero.  Velocities and spins are those of the bodies
    as they were made, in space: bodies that have turned spin about the same axis.

    Args:
        system: the other scene's system, e.g. `equilibrium.system`.

    Raises:
        InputError: something that is not a compiled scene; when the scene is compiled, a body that
            the other scene does not have, or has with another mesh.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> start = gx.StartFrom(equilibrium.system)
        >>> swing = gx.Simulation(gx.Scene(weight, spring, start), gx.Midpoint(dt=0.01))
        >>> round(gx.probes.Position(mass.port(), "z")(swing), 3)
        -1.1
    """

    system: System
    _: KW_ONLY
    name: str = "start"
    stage: ClassVar[int] = 2

    def initialise(self, start: InitialState) -> None:
        """Place all bodies of the scene as they are in the other one.  Velocities stay, and so do
        angular velocities, with which directors turn."""
        for body in start:
            made = body.coordinates().copy()
            start.place(body.body, self._coordinates(body))
            # The vectors of a reduced film are the coefficients of its modes.
            if not _is_reduced(body.body):
                rates = _rates_of_turned(body.rates().copy(), made, body.coordinates())
                start.set_in_motion(body.body, rates)

    def _coordinates(self, here: BodyState) -> Array:
        """Positions [m] and directors of this rank's nodes of the body of the same name in the
        other scene, flattened; of a reduced film the coefficients [m] of its modes, projected from
        a full film."""
        body = here.body
        there = self.system.unknowns.state.named(body.name)
        # Only a reduced film differs from its full one.
        full = body.full if isinstance(body, MeshBody) else body
        from_full = full is not body and there is not None and there.body is full
        check(
            there is not None and (from_full or there.body.block.size == body.block.size),
            f"'{self.name}' has no body '{body.name}' like this scene's; "
            "start from the same bodies.",
        )
        assert there is not None
        values = there.coordinates().ravel()
        if from_full:
            values = body.reduced(values)  # type: ignore[attr-defined]
        check_on_all(
            body.comm,
            len(values) == here.coordinates().size,
            f"'{body.name}' has other nodes in '{self.name}'; use the same mesh.",
        )
        return values


def _is_reduced(body: Body) -> bool:
    """Whether a body is a reduced film."""
    return isinstance(body, MeshBody) and body.full is not body


def _rates_of_turned(rates: Array, made: Array, placed: Array) -> Array:
    """Rates (n, s, 3) of a position and s - 1 orthonormal directors, which turn at the angular
    velocity that `rates` are at the coordinates `made`, at the coordinates `placed`."""
    of_directors = rates[:, 1:]
    has_turned = not np.array_equal(made[:, 1:], placed[:, 1:])
    if not has_turned or not of_directors.any():
        return rates
    # The angular velocity is ½ Σ d × ḋ of three directors; a beam has two, and their normal.
    directors = made[:, 1:]
    spin = np.cross(directors, of_directors).sum(axis=1)
    if directors.shape[1] == 2:
        normal = np.cross(directors[:, 0], directors[:, 1])
        normal_rate = np.cross(of_directors[:, 0], directors[:, 1])
        normal_rate += np.cross(directors[:, 0], of_directors[:, 1])
        spin += np.cross(normal, normal_rate)
    turned = rates.copy()
    turned[:, 1:] = np.cross(spin[:, None] / 2, placed[:, 1:])
    return turned


@check_arguments
class Scene:
    """The items of a scene and, through them, all that they refer to.

    Args:
        items: bodies, gas items, loads, constraints, connectors, contacts, initial conditions.

    Raises:
        InputError: no items, something that is not an item, two items of one name.

    Example:
        >>> scene = gx.Scene(film, gx.Gravity(film))
        >>> [item.name for item in scene.items]
        ['film', 'gravity of film']
    """

    def __init__(self, *items: Item) -> None:
        self.items: list[Item] = []
        for item in items:
            self._add(item)
        check(bool(self.items), "The scene is empty; give it a body or a chamber.")
        # Outputs, checkpoints and the ledger find items by their names.
        names = [item.name for item in self.items]
        check(
            all(name.strip() for name in names),
            "An item of the scene has a name without letters; give it another one by name=....",
        )
        twice = sorted({n for n in names if names.count(n) > 1})
        check(
            not twice,
            f"Two items of the scene are called '{twice[0] if twice else ''}'; "
            "give each its own by name=....",
        )

        starts = [item.name for item in self.items if isinstance(item, StartFrom)]
        check(
            len(starts) < 2,
            f"The scene has several StartFrom ({', '.join(starts)}), of which the last would hold; "
            "give one.",
        )

    def _add(self, item: Item) -> None:
        """Add an item and all that it refers to, each once."""
        if any(item is known for known in self.items):
            return
        for other in item.requires():
            check(
                isinstance(other, Item),
                f"'{item.name}' requires {other!r}, which is not an item of a scene; derive its "
                "class from gossamer_fx.extend.Item.",
            )
            self._add(other)
        # After what it refers to: terms may need an item that is compiled before.
        self.items.append(item)

    def __repr__(self) -> str:
        """Kinds and names of the items."""
        names = [f"{type(item).__name__} '{item.name}'" for item in self.items]
        return f"<Scene of {', '.join(names)}>"

    def _repr_html_(self) -> str:
        """The items as an HTML table, for notebooks: kind, name, and size of the mesh where there
        is one."""
        rows = []
        for item in self.items:
            size = ""
            mesh = getattr(item, "mesh", None)
            if mesh is not None:
                size = repr(mesh).strip("<>")
            rows.append((type(item).__name__, item.name, size))
        return table(("kind", "name", "mesh"), rows)

    @property
    def bodies(self) -> list[Body]:
        """Bodies of the scene, those that items ask for included."""
        return [item for item in self.items if isinstance(item, Body)]

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the bodies.  A scene without bodies has that of all ranks, each of which
        computes the same."""
        return self.bodies[0].comm if self.bodies else MPI.COMM_WORLD

    def _refuse_other_ranks(self) -> None:
        """Raise `InputError` if the bodies are not all on the same ranks.  They have no
        communicator in common, so that ranks do not exchange what they find."""
        for body in self.bodies:
            same = MPI.Comm.Compare(body.comm, self.comm) in (MPI.IDENT, MPI.CONGRUENT)
            check(
                same,
                f"'{body.name}' is on {body.comm.size} ranks and '{self.bodies[0].name}' on "
                f"{self.comm.size}; make all bodies of a scene with the same comm.",
            )

    @check_arguments
    def compile(self, rule: StressRule | None = None) -> System:
        """Number the unknowns, compile the forms for a stress rule, by default the path average,
        which conserves energy, and take the initial state.  Collective."""
        # Before anything is compiled, which takes seconds for new forms.
        self._refuse_other_ranks()
        validate(self.items, self.comm)
        for body in self.bodies:
            for what, values in zip(
                ("displacement", "velocity"), body.initial_state(), strict=True
            ):
                check_on_all(
                    self.comm,
                    bool(np.isfinite(values).all()),
                    f"The initial {what} of '{body.name}' is not finite everywhere; "
                    "check the function that gives it.",
                )
        start = InitialState(self.bodies, self.comm)
        conditions = [item for item in self.items if isinstance(item, InitialCondition)]
        for condition in sorted(conditions, key=lambda one: one.stage):
            condition.initialise(start)
        items = [ItemTerms(item, list(item.terms(start))) for item in self.items]
        system = System(start, items, rule or PathAverage())
        kinds: dict[type[ScalarUnknowns], list[object]] = {}
        for item in self.items:
            if isinstance(item, BringsScalarUnknowns):
                kinds.setdefault(item.scalar_unknowns, []).append(item)
        for kind, alike in kinds.items():
            system.equations.scalar_unknowns.append(kind(alike, system.unknowns))
        # After the gas network, which names the base class that an item of gas lacks.
        _check_that_all_add(self.items, [one.terms for one in items])
        # Last: masses, constraints and gas start from the complete initial state.
        initialise(system)
        for condition in conditions:
            if isinstance(condition, StartFrom):
                take_shape_history(system, condition.system)
        return system


def _check_that_all_add(items: Sequence[Item], terms: Sequence[Sequence[Term]]) -> None:
    """Refuse an item that adds nothing to a scene and that no other one refers to: what its user
    means would not be computed, without a word."""
    referred = [other for item in items for other in item.requires()]
    roles = (Body, InitialCondition, BringsScalarUnknowns, Sampled, Group)
    for item, brought in zip(items, terms, strict=True):
        check(
            bool(brought) or isinstance(item, roles) or any(item is other for other in referred),
            f"'{item.name}' ({type(item).__name__}) adds nothing to the scene, as its terms() are "
            "empty; leave it out, or derive a volume, an opening or a wall of gas from "
            "gossamer_fx.extend.Volume, Opening or Wall, and what only brings others from Group.",
        )
