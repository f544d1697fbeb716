"""Stow a finished film by tools: empty it, press it, fold it over lines, pack it into a box.

Problem.  A bag or a sail that is sewn and closed has no isometric map to its stowed shape, as it is
no flat sheet any more.  It is folded as by hand: a plate presses it, a blade lies on a line, a flap
lifts one side and lays it over the blade, which is drawn out.

Idea.  Tools are obstacles that move and turn as prescribed, so that a run with contact folds the
film.  What they do follows from the size L of the film and the spacing D of its layers alone:

    τ = (L/g)^½                     time in which film falls by about its size
    c = (n + 1) 1.25 D              height between floor and plate of n layers

A fold doubles the layers.  The outline of the film in the plane of the floor, a convex polygon, is
mirrored at each line, so that later tools have the size that is needed.

Nothing rubs, so that film would turn and slide on the floor when a flap lifts one side: a tube did,
by 90°.  Two grips hold points of the lowest layer that no fold lifts along the floor, by springs
that give way by the spacing D under the weight of the film.

Tools pass through each other; only the film feels them.  The floor is at the height 0 of this
module, and a tool that waits is far away.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Annotated

import numpy as np
import ufl
from dolfinx import fem
from scipy.spatial import ConvexHull, QhullError

from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import (
    Direction,
    Range,
    at_least,
    check_arguments,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Port, Vector, unit
from gossamer_fx.core.model.item import Group, Item
from gossamer_fx.core.model.state import HasSystem, Sampled
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.connectors.spring import AxialSpring
from gossamer_fx.mechanics.constraints.fixed import Driven
from gossamer_fx.mechanics.contact.contact import Contact
from gossamer_fx.mechanics.contact.obstacles import Box, Obstacle, Plane
from gossamer_fx.mechanics.loads.body_forces import Gravity
from gossamer_fx.mechanics.loads.damping import Damping
from gossamer_fx.mechanics.loads.pressure import Pressure

LOG = logging.getLogger("gossamer_fx")

# Height between floor and plate over that of n layers at a distance D from each other and from
# both: pressed any closer, film that lies in waves has no room.
LOOSENESS = 1.25

# Extent of tools over that of the outline as it was seen from above: a tube that is pressed flat
# becomes wider by π/2.
WIDENING = 1.6

# Mass-proportional damping over 1/τ and stiffness-proportional damping over τ, of a bag that stays
# calm: falling film has some half of the speed that it had undamped.
MASS_DAMPING = 3.0
STIFFNESS_DAMPING = 1 / 140

# The first step over τ, and the longest one.
FIRST_STEP = 1 / 70
LONGEST_STEP = 1 / 5

# Durations over τ: of emptying, of pressing, of a blade or plate that comes or goes, of a flap that
# turns, of rest at the end of a step.
EMPTYING = 2.0
PRESSING = 4.0
TRAVEL = 2.5
TURNING = 7.0
REST = 1.0

# How far tools are that wait, in sizes of the film.
FAR = 4.0

# Grips hold nodes that are no higher over the lowest ones than this part of the height of the film.
GRIP_RISE = 0.25

# The second grip is at least this part of the distance of the first one from all lines.
GRIP_SHARE = 0.5

# Film that lies behind the line of a fold by more than this share of what was laid over it has
# slipped.
SLIPPED_SHARE = 0.2

Length = Annotated[float, positive("m")]


def smooth(x: float) -> float:
    """A step from 0 to 1 for x from 0 to 1, with rates and accelerations of zero at its ends."""
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


@dataclass
class Course:
    """A number as a function of time [s], which changes smoothly in given intervals.

    Attributes:
        moves: start and end [s], and the change.
    """

    start: float = 0.0
    moves: list[tuple[float, float, float]] = field(default_factory=list)

    @property
    def end(self) -> float:
        """The value after all changes."""
        return self.start + sum(change for _, _, change in self.moves)

    def go(self, value: float, begin: float, duration: float) -> None:
        """Go to a value from a time [s] on."""
        self.moves.append((begin, begin + duration, value - self.end))

    def at(self, t: float) -> float:
        """The value at a time [s]."""
        value = self.start
        for begin, end, change in self.moves:
            value += change * smooth((t - begin) / (end - begin))
        return value

    def along(self, direction: Array) -> Callable[[float], tuple[float, float, float]]:
        """The displacement from the start along a direction (3,), as a function of time [s]."""

        def displacement(t: float) -> tuple[float, float, float]:
            x, y, z = (self.at(t) - self.start) * direction
            return float(x), float(y), float(z)

        return displacement


@dataclass(frozen=True, eq=False)
class MadeFold:
    """Where a fold is made.

    Attributes:
        name: e.g. "fold 1".
        point: on the line, along the floor (2,) [m].
        direction: unit vector (2,) across it, towards which film is laid over.
        length: of the part that is laid over it [m].
        bend: height of the hinge [m], by which film round the blade's edge may stand behind it.
        end: time at which it is made [s].
    """

    name: str
    point: Array
    direction: Array
    length: float
    bend: float
    end: float

    def distance(self, points: Array) -> Array:
        """Distances (n,) [m] of points (n, 2) from the line, positive ahead of it."""
        return np.asarray((points - self.point) @ self.direction)


class _Plan:
    """What has been planned so far.

    Attributes:
        spacing: D [m].
        axes: rows (3, 3): two directions in the plane of the floor, and the one upwards.
        origin: point (3,) [m] on the floor.
        tau: τ [s].
        time: end [s] of what is planned.
        layers: of the film, where they are most.
        outline: corners (k, 2) [m] of a convex polygon around the film, from above.
        first_outline: that of the film as it was made.
        plate: height [m] of the plate over the floor.
        suction: [Pa] below the surroundings.
        obstacles, items: tools, and what moves them.
        walls: courses of the walls of a box.
        ends: times [s] at which the steps so far have ended.
        folds: of those so far.
    """

    def __init__(self, stow: Stow) -> None:
        films = stow.films
        self.comm = films[0].comm
        self.spacing = stow.spacing
        self.layers = stow.layers
        up = unit(stow.up)
        # Along x of space, unless that is upwards.
        first = np.array([1.0, 0.0, 0.0]) - up[0] * up
        if np.linalg.norm(first) < 0.1:
            first, _ = perpendicular_pair(up)
        first = first / np.linalg.norm(first)
        self.axes: Array = np.array([first, np.cross(up, first), up])
        positions = [film.initial_state()[0].reshape(-1, 3) for film in films]
        points = np.concatenate(positions) @ self.axes.T
        # Hulls have few points, other than the film.
        corners = self.comm.allgather(_hull(points[:, :2]))
        self.outline = _hull(np.concatenate(corners))
        self.first_outline = self.outline
        own_low = points[:, 2].min(initial=np.inf)
        own_high = points[:, 2].max(initial=-np.inf)
        low = min(self.comm.allgather(float(own_low)))
        high = max(self.comm.allgather(float(own_high)))
        self.size = float(np.ptp(self.outline, axis=0).max())
        self.tau = math.sqrt(self.size / stow.gravity)
        self.origin: Array = (low - 1.5 * self.spacing) * up
        self.time = 0.0
        self.plate = Course(high - low + 3 * self.spacing)
        self.suction = Course()
        self.obstacles: list[Obstacle] = []
        self.items: list[Item] = []
        self.walls: list[Course] = []
        self.ends: list[float] = []
        self.folds: list[MadeFold] = []
        self.obstacles.append(Plane(point=_vector(self.origin), normal=_vector(up), name="floor"))

    def height(self, layers: int) -> float:
        """Height [m] between floor and plate for a number of layers."""
        return LOOSENESS * (layers + 1) * self.spacing

    def point(self, plane: Array, height: float) -> Array:
        """A point (3,) [m] in space, from its components (2,) [m] along the floor and its height
        [m] over it."""
        return self.origin + plane @ self.axes[:2] + height * self.axes[2]

    def wait(self, duration: float) -> None:
        """Go on by a duration [s]."""
        self.time += duration

    def press(self, height: float, duration: float) -> None:
        """Bring the plate to a height [m] over the floor, in a duration [s]."""
        self.plate.go(height, self.time, duration)
        self.wait(duration)


def _vector(values: Array) -> tuple[float, float, float]:
    """An array (3,) as a vector."""
    x, y, z = values
    return float(x), float(y), float(z)


def _hull(points: Array) -> Array:
    """The corners (k, 2) of the convex hull of points (n, 2), all of them if they are on a line."""
    if len(points) < 3:
        return points
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def _largest(score: Array) -> list[int]:
    """The index of the largest of scores (n,), or none of no scores."""
    return [int(score.argmax())] if len(score) else []


def _ahead_of(outline: Array, distance: Array) -> Array:
    """The part (k, 2) of a convex polygon where a distance (n,) of its corners is not negative."""
    found = []
    following = np.roll(outline, -1, axis=0)
    distance_after = np.roll(distance, -1)
    for a, b, at_a, at_b in zip(outline, following, distance, distance_after, strict=True):
        if at_a >= 0:
            found.append(a)
        if at_a * at_b < 0:
            found.append(a + at_a / (at_a - at_b) * (b - a))
    return np.array(found).reshape(-1, 2)


class StowStep(ABC):
    """A step of stowing."""

    @abstractmethod
    def plan(self, plan: _Plan) -> None:
        """Add its tools and their courses to a plan; `InputError` if it cannot be made."""


@dataclass(frozen=True)
class _Evacuate(StowStep):
    suction: float

    def plan(self, plan: _Plan) -> None:
        duration = EMPTYING * plan.tau
        plan.suction.go(self.suction, plan.time, duration)
        plan.wait(duration)


@dataclass(frozen=True)
class _Press(StowStep):
    def plan(self, plan: _Plan) -> None:
        plan.press(plan.height(plan.layers), PRESSING * plan.tau)
        plan.wait(REST * plan.tau)


@dataclass(frozen=True)
class _Fold(StowStep):
    number: int
    point: Vector
    towards: Vector

    def plan(self, plan: _Plan) -> None:
        owner = f"Stow: fold {self.number}"
        direction = plan.axes[:2] @ np.asarray(self.towards, dtype=float)
        length = float(np.linalg.norm(direction))
        check(
            length > 1e-9 * float(np.linalg.norm(self.towards)),
            f"{owner} goes towards {tuple(self.towards)!r}, which has no part along the floor; "
            "give a direction across up.",
        )
        direction = direction / length
        line = plan.axes[:2] @ np.asarray(self.point, dtype=float)
        distance = (plan.outline - line) @ direction
        ahead = _ahead_of(plan.outline, distance)
        behind = _ahead_of(plan.outline, -distance)
        check(
            float(distance.max()) > plan.spacing and float(distance.min()) < -plan.spacing,
            f"{owner}: the line through {tuple(self.point)!r} across {tuple(self.towards)!r} does "
            "not cross the film as it then lies; move the point.",
        )
        hinge = self._tools(plan, line, direction, distance)
        mirrored = behind - 2 * ((behind - line) @ direction)[:, None] * direction
        plan.outline = _hull(np.concatenate([ahead, mirrored]))
        plan.layers *= 2
        plan.press(plan.height(plan.layers), PRESSING * plan.tau)
        plan.wait(REST * plan.tau)
        length = -float(distance.min())
        fold = MadeFold(f"fold {self.number}", line, direction, length, hinge, plan.time)
        plan.folds.append(fold)

    def _tools(self, plan: _Plan, line: Array, direction: Array, distance: Array) -> float:
        """Plan the blade and the flap; returns the height of the hinge [m].  `line`: point (2,)
        [m]; `distance` (k,) [m] of the corners of the outline from the line, along a direction
        (2,)."""
        tau = plan.tau
        gap = plan.spacing
        height = plan.height(plan.layers)
        across = np.array([-direction[1], direction[0]])
        lateral = plan.outline @ across
        width = 2 * WIDENING * float(np.ptp(lateral))
        middle = (float(lateral.max()) + float(lateral.min())) / 2
        line = line + (middle - float(line @ across)) * across
        axes = [direction @ plan.axes[:2], across @ plan.axes[:2], plan.axes[2]]
        box_axes = tuple(_vector(axis) for axis in axes)

        # The blade comes over the side that stays, and ends above the line.
        blade_length = WIDENING * float(distance.max())
        centre = line + (blade_length / 2) * direction
        # Where it waits it is outside of the film as it was before all folds, too.
        reach = float(((plan.first_outline - line) @ direction).max())
        away = max(1.2 * blade_length, WIDENING * reach) + gap
        blade = Course(away)
        hinge = height + gap
        blade_box = Box(
            centre=_vector(plan.point(centre + away * direction, hinge)),
            sizes=(blade_length, width, gap),
            axes=box_axes,
            motion=blade.along(axes[0]),
            name=f"blade {self.number}",
        )
        blade.go(0.0, plan.time, TRAVEL * tau)
        plan.wait(TRAVEL * tau)

        # The flap waits below the floor, and turns about the hinge, above the blade's middle.
        reach = WIDENING * -float(distance.min())
        below = 0.2 * gap
        thickness = 2 * gap
        inner = hinge + 2 * gap
        flap_centre = line - (inner + reach) / 2 * direction
        body = RigidBody(
            1e-3,
            (1e-6, 1e-6, 1e-6),
            position=_vector(plan.point(line, hinge)),
            comm=plan.comm,
            name=f"flap {self.number}",
        )
        flap_box = Box(
            centre=_vector(plan.point(flap_centre, -below - thickness / 2)),
            sizes=(reach - inner, width, thickness),
            axes=box_axes,
            body=body,
            name=f"plate of flap {self.number}",
        )
        angle = Course()
        lift = Course()
        clear = hinge + reach + 4 * gap
        plan.plate.go(clear, plan.time, TRAVEL * tau)
        plan.wait(TRAVEL * tau / 2)
        angle.go(math.pi, plan.time, TURNING * tau)
        plan.wait(TURNING * tau)
        # Down to the flap, which then is drawn off upwards, and the blade after it.
        plan.press(2 * hinge + 2 * below, TRAVEL * tau)
        lift.go(FAR * plan.size, plan.time, TRAVEL * tau)
        blade.go(away, plan.time + TRAVEL * tau / 2, TRAVEL * tau)
        plan.wait(1.5 * TRAVEL * tau)
        plan.obstacles += [blade_box, flap_box]
        # From the side behind upwards, over the line
        turning = Driven(
            body,
            _vector(axes[1]),
            angle=angle.at,
            displacement=lift.along(axes[2]),
            name=f"hinge of flap {self.number}",
        )
        plan.items.append(turning)
        return hinge


@dataclass(frozen=True)
class _Pack(StowStep):
    sizes: tuple[float, float, float]

    def plan(self, plan: _Plan) -> None:
        low = plan.outline.min(axis=0)
        high = plan.outline.max(axis=0)
        middle = (low + high) / 2
        duration = PRESSING * plan.tau
        for k in range(2):
            for sign in (-1.0, 1.0):
                inwards = -sign * plan.axes[k]
                # Outside of the film, however much wider it is than its outline was.
                outside = WIDENING * float(high[k] - low[k]) / 2 + 2 * plan.spacing
                outside = max(outside, plan.size / 2 + 2 * plan.spacing)
                # Where it waits it is outside of the film as it was before all folds, too.
                far = FAR * plan.size
                start = plan.point(middle, 0.0) - far * inwards
                course = Course()
                course.go(far - outside, plan.time, TRAVEL * plan.tau)
                course.go(far - self.sizes[k] / 2, plan.time + TRAVEL * plan.tau, duration)
                wall = Plane(
                    point=_vector(start),
                    normal=_vector(inwards),
                    motion=course.along(inwards),
                    name=f"wall {len(plan.walls) + 1}",
                )
                plan.walls.append(course)
                plan.obstacles.append(wall)
        plan.wait(TRAVEL * plan.tau)
        plan.press(self.sizes[2], duration)
        plan.wait(REST * plan.tau)


@dataclass(frozen=True)
class _Release(StowStep):
    def plan(self, plan: _Plan) -> None:
        away = plan.size
        duration = TRAVEL * plan.tau
        plan.plate.go(plan.plate.end + away, plan.time, duration)
        for course in plan.walls:
            course.go(course.end - away, plan.time, duration)
        plan.suction.go(0.0, plan.time, duration)
        plan.wait(duration + REST * plan.tau)


@check_arguments
@dataclass(frozen=True, eq=False)
class Stow(Group, Sampled):
    """Stows a finished film: an item of a scene that brings tools, contact, weight, suction and
    damping, all of which follow from the size of the film and the spacing of its layers.

    Steps are methods that return a longer stow.  The film lies on a floor below it, as it was made.
    A run until `end` with steps from `first_step` to `longest_step` stows it; a scene that shall
    begin with the stowed film takes `gx.StartFrom(run.system)`.  To do this in another process,
    make the stow again, and the run with `restart` from its checkpoints.  Film that lies behind the
    line of a fold after it was made has slipped, which is warned of in the run (`slip`).

    Layers must not intersect or coincide at the start; contact refuses them, and names where.  A
    box that is smaller than the area of the film times D is warned of before the run, whose steps
    then probably fail.

    Args:
        film: one, or several that are sewn; its `displacement` opens layers that would coincide.
        spacing: distance D [m] between layers, the activation distance of `gx.Contact`: at most
            half of the shortest edge.
        layers: of the film that lie on each other before it is folded: two of a bag.
        up: direction away from the floor; gravity acts against it.
        gravity: [m/s²].

    Raises:
        InputError: a value out of its range, no film; where tools are made: a fold whose line does
            not cross the film.

    Example:
        >>> stow = gx.fold.Stow(film, spacing=1e-3, layers=1).press().fold((0.5, 0, 0), (1, 0, 0))
        >>> [item.name for item in stow.requires()][-2:], stow.layers_at_end
        (['hinge of flap 1', 'stow contact'], 2)
    """

    film: Membrane | Annotated[Sequence[Membrane], at_least(1)]
    _: KW_ONLY
    spacing: Length
    layers: Annotated[int, Range(1)] = 2
    up: Direction = (0.0, 0.0, 1.0)
    gravity: Annotated[float, positive("m/s²")] = 9.81
    steps: tuple[StowStep, ...] = ()
    name: str = "stow"

    @property
    def films(self) -> tuple[Membrane, ...]:
        """The films that it stows."""
        return (self.film,) if isinstance(self.film, Membrane) else tuple(self.film)

    @check_arguments
    def evacuate(self, suction: Annotated[float, not_negative("Pa")]) -> Stow:
        """Draw the gas out of a bag: its pressure goes to `suction` [Pa] below that outside, and
        stays there until `release`.  Without suction a pressed bag springs back.

        Raises:
            InputError: a film of one layer, which encloses no gas.
        """
        check(
            self.layers > 1,
            f"Stow '{self.name}': a film of one layer encloses no gas to evacuate; "
            "leave evacuate out, or give layers=2.",
        )
        return self._with(_Evacuate(suction))

    @check_arguments
    def press(self) -> Stow:
        """Bring a plate down to the height that the layers need."""
        return self._with(_Press())

    @check_arguments
    def fold(self, point: Vector, towards: Vector) -> Stow:
        """Fold the film over a line, and press it.

        A blade comes over the side that stays; a flap lifts the other one, turns half round about
        the line, and lays it over the blade, which is then drawn out.

        Args:
            point: on the line [m], as the film lies at that time; its height does not matter.
            towards: direction along the floor, across the line, in which the part behind it is
                laid over the part ahead.
        """
        number = 1 + sum(isinstance(step, _Fold) for step in self.steps)
        return self._with(_Fold(number, point, towards))

    @check_arguments
    def pack(self, sizes: tuple[Length, Length, Length]) -> Stow:
        """Let four walls and the plate close to a box around the middle of the film.

        Args:
            sizes: of the box [m], along the projection of x on the floor, across it, and upwards.
        """
        return self._with(_Pack(sizes))

    @check_arguments
    def release(self) -> Stow:
        """Take plate, walls and suction away: what then is larger has sprung back."""
        return self._with(_Release())

    def _with(self, step: StowStep) -> Stow:
        return replace(self, steps=(*self.steps, step))

    @property
    def end(self) -> float:
        """Time [s] at which the last step has ended."""
        return self._plan.time

    @property
    def ends(self) -> list[float]:
        """Times [s] at which the steps end, for pictures or checkpoints of all stages."""
        return self._plan.ends

    @property
    def first_step(self) -> float:
        """Length [s] of the first step of a run."""
        return FIRST_STEP * self._plan.tau

    @property
    def longest_step(self) -> float:
        """Length [s] of the longest step of a run, for `gx.StepControl`."""
        return LONGEST_STEP * self._plan.tau

    @property
    def layers_at_end(self) -> int:
        """Number of layers that lie on each other after all folds."""
        return self._plan.layers

    @property
    def contact(self) -> Contact:
        """The contact of the film with itself and the tools, for probes."""
        return self._items[-1]  # type: ignore[return-value]

    @check_arguments
    def box(self, run: HasSystem) -> Array:
        """Sizes (3,) [m] of the box around the film in a run: along the projection of x on the
        floor, across it, and upwards.  Collective."""
        points = self._positions(run)
        low = np.min(self._plan.comm.allgather(points.min(axis=0, initial=np.inf)), axis=0)
        high = np.max(self._plan.comm.allgather(points.max(axis=0, initial=-np.inf)), axis=0)
        return np.asarray(high - low)

    @check_arguments
    def slip(self, run: HasSystem) -> float:
        """How far film lies behind the line of the last fold that is made [m], beyond its bend
        round the line; zero before the first one.  Collective."""
        made = [fold for fold in self._plan.folds if fold.end <= run.system.unknowns.time]
        if not made:
            return 0.0
        behind = -made[-1].distance(self._positions(run)[:, :2]) - made[-1].bend
        return max(self._plan.comm.allgather(float(behind.max(initial=0.0))))

    def _positions(self, run: HasSystem) -> Array:
        """Positions (n, 3) [m] of this rank's nodes of all films, along the axes of the floor and
        upwards."""
        state = run.system.unknowns.state
        points = np.concatenate([state[film].positions() for film in self.films])
        return np.asarray(points @ self._plan.axes.T)

    def before_step(self, run: HasSystem, h: float) -> float:
        """Warn once of each fold that has slipped.  Collective."""
        unknowns = run.system.unknowns
        for fold in self._plan.folds:
            # In the first step after its end.
            if unknowns.previous_time < fold.end <= unknowns.time:
                self._check(fold, self.slip(run))
        return h

    def _check(self, fold: MadeFold, slipped: float) -> None:
        """Warn of a fold that has slipped by a length [m]."""
        if slipped > SLIPPED_SHARE * fold.length and self._plan.comm.rank == 0:
            LOG.warning(
                "Stow '%s': after %s film lies up to %.3g m behind its line, over which %.3g m "
                "were to be laid; look at the shape, and fold it another way.",
                *(self.name, fold.name, slipped, fold.length),
            )

    def warnings(self, items: Iterable[Item]) -> Iterable[str]:
        boxes = [step.sizes for step in self.steps if isinstance(step, _Pack)]
        if not boxes:
            return
        needed = self.spacing * self._sum(lambda film: ufl.as_ufl(1))
        for sizes in boxes:
            volume = math.prod(sizes)
            if volume < needed:
                yield (
                    f"Stow '{self.name}': the box has {volume:.3g} m³, and the film, at its "
                    f"spacing of {self.spacing:.3g} m, needs {needed:.3g} m³; give a larger box, "
                    "or a smaller spacing."
                )

    def _sum(self, density: Callable[[Membrane], Expr]) -> float:
        """The integral of a density over all films, as they were made.  Collective."""
        total = 0.0
        for film in self.films:
            form = compile_form(density(film) * film.mass_dx)
            total += self._plan.comm.allreduce(float(fem.assemble_scalar(form)))
        return total

    def requires(self) -> Iterable[Item]:
        return self._items

    @cached_property
    def _plan(self) -> _Plan:
        """All tools and their courses.  Collective."""
        plan = _Plan(self)
        for step in self.steps:
            step.plan(plan)
            plan.ends.append(plan.time)
        return plan

    @cached_property
    def _items(self) -> list[Item]:
        """The items that it brings; the contact is the last one."""
        plan = self._plan
        up = plan.axes[2]
        plate = Plane(
            point=_vector(plan.origin + plan.plate.start * up),
            normal=_vector(-up),
            motion=plan.plate.along(up),
            name="plate",
        )
        items: list[Item] = []
        for film in self.films:
            suffix = "" if len(self.films) == 1 else f" of {film.name}"
            weight = _vector(-self.gravity * up)
            damping = Damping(
                film,
                mass_factor=MASS_DAMPING / plan.tau,
                stiffness_factor=STIFFNESS_DAMPING * plan.tau,
                name=f"{self.name} damping{suffix}",
            )
            items += [film, Gravity(film, weight, name=f"{self.name} weight{suffix}"), damping]
            if plan.suction.moves:
                items.append(Pressure(film, self._pressure, name=f"{self.name} suction{suffix}"))
        contact = Contact(
            *self.films,
            plate,
            *plan.obstacles,
            distance=self.spacing,
            name=f"{self.name} contact",
        )
        return [*items, *self._grips(), *plan.items, contact]

    def _grips(self) -> list[Item]:
        """Springs along the floor that hold two points which no fold lifts.  Collective."""
        plan = self._plan
        points = self._points_ahead() if plan.folds else []
        if not points:
            return []
        weight = self.gravity * self._sum(lambda film: film.area_density)
        return [
            AxialSpring(
                port,
                weight / plan.spacing,
                direction=_vector(plan.axes[axis]),
                origin=_vector(position),
                name=f"{self.name} grip {k + 1}{'ab'[axis]}",
            )
            for k, (port, position) in enumerate(points)
            for axis in range(2)
        ]

    def _points_ahead(self) -> list[tuple[Port, Array]]:
        """Two nodes, with their positions (3,) [m] at the start, that lie low and ahead of the
        lines of all folds: the one that is furthest from these lines, and of those that are
        half as far from them at least the one that is furthest from it.  None if there are no two
        nodes.  Collective."""
        plan = self._plan
        nodes: list[tuple[int, int]] = []
        positions = np.zeros((0, 3))
        for number, film in enumerate(self.films):
            own = film.initial_state()[0].reshape(-1, 3)
            local = np.arange(len(own), dtype=np.int32)
            nodes += [(number, int(k)) for k in film.block.index_map.local_to_global(local)]
            positions = np.concatenate([positions, own])
        ahead = np.full(len(positions), np.inf)
        for fold in plan.folds:
            ahead = np.minimum(ahead, fold.distance(positions @ plan.axes[:2].T))
        heights = positions @ plan.axes[2] - plan.origin @ plan.axes[2]
        lowest = min(plan.comm.allgather(float(heights[ahead > 0].min(initial=np.inf))))
        rise = heights - lowest
        # Film that stands higher moves along the floor when it is pressed.
        ahead[rise > max(plan.spacing, GRIP_RISE * plan.plate.start)] = -np.inf

        def best(score: Array) -> tuple[float, Vector, tuple[int, int]]:
            """The largest score of all ranks, and the position and the node that have it."""
            own = [(float(score[k]), _vector(positions[k]), nodes[k]) for k in _largest(score)]
            return max(row for rows in plan.comm.allgather(own) for row in rows)

        # Of nodes at the same distance the lowest one.
        distance, first, node = best(ahead - rise)
        if distance <= 0:
            return []
        apart = np.linalg.norm(positions - first, axis=1) - rise
        gap, second, other = best(np.where(ahead >= GRIP_SHARE * distance, apart, -np.inf))
        if gap <= 0:
            return []
        return [
            (Port(self.films[film], (number,)), np.array(position))
            for position, (film, number) in ((first, node), (second, other))
        ]

    def _pressure(self, t: float) -> float:
        """Pressure [Pa] of the film along its normal at a time [s]."""
        return -self._plan.suction.at(t)
