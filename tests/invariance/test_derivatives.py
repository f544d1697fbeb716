"""Every derivative of every kind of scene agrees with differences or is refused by name: of runs
and of equilibria, for each pair of a result and a parameter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.sensitivity.backward import BackwardSteps
from gossamer_fx.analysis.sensitivity.transient import TransientGradients
from gossamer_fx.analysis.sensitivity.variables import (
    INITIAL_POSITION,
    INITIAL_VELOCITY,
    SHAPE,
    SPIN,
    VELOCITY,
    AdjointFields,
    ScalarVariable,
    Variable,
    _names_of,
    find_variables,
    refuse_unknown_kinds,
)
from gossamer_fx.core.checks.errors import NotConverged
from tests.invariance.kinds import KINDS, Kind, Made
from tests.invariance.transformations import (
    ALL_AT_ONCE,
    SAME,
    Array,
    Description,
    Transformation,
)

IN_TIME = [kind for kind in KINDS if kind.dt > 0]
AT_REST = [kind for kind in KINDS if kind.dt == 0]

# Few steps have all terms of a step and of what is carried from one to the next.
STEPS = 4

# Forces [N] that are round-off where they are not small compared with those of the motion.
ROUND_OFF_FORCES = {"heated film": 1e-10}

# Change of the values of a parameter in differences, over their size; of what decides the strains
# of stiff film a smaller one.
STEP = 1e-4
STARTS = (SHAPE, INITIAL_POSITION, INITIAL_VELOCITY)
STEPS_OF = {SHAPE: 1e-6, INITIAL_POSITION: 1e-6, INITIAL_VELOCITY: 1e-5, SPIN: 1e-5, VELOCITY: 1e-5}

# Where film wrinkles and pairs come into contact the second derivative jumps: then differences
# deviate in proportion to the change, which is divided by ten up to this many times.
REFINEMENTS = 3

# Deviation from differences over the sum of the sizes of all products of a derivative and a change.
DEVIATION = 1e-4

# Round-off of results over their size: of energies, of what is measured from positions, and of
# pressures, which follow from volumes.
NOISE = 2e-13


def results_of(made: Made, in_time: bool) -> list[Any]:
    """Results of a scene that have derivatives, of each kind that it can have."""
    names = sorted(made.ports)
    last = made.ports[names[-1]]
    results: list[Any] = [
        gx.analysis.Energy(),
        gx.probes.Position(last, "z"),
        gx.probes.Position(made.ports[names[0]], "x"),
        gx.probes.Displacement(last, "y"),
    ]
    films = [part for part in made.parts if isinstance(part, gx.Membrane)]
    if films:
        results.append(gx.analysis.EnclosedVolume(films[0]))
    if in_time:
        results.append(gx.probes.Velocity(last, "x"))
    chambers = [part for part in made.parts if getattr(part, "name", "") in made.gas]
    results += [gx.analysis.ChamberPressure(chamber) for chamber in chambers]
    return results


def named(parts: Sequence[Any], name: str) -> Any:
    """The item of a name among parts of a scene and what they require."""
    for part in parts:
        if getattr(part, "name", "") == name:
            return part
    required = [one for part in parts if hasattr(part, "requires") for one in part.requires()]
    assert required, name
    return named(required, name)


def results_like(results: Sequence[Any], made: Made) -> list[Any]:
    """The same results of the same scene that was made again."""
    again = results_of(made, True)
    kinds = [type(one) for one in results]
    return [one for one in again if type(one) in kinds]


class RecordedRun:
    """A few steps of a scene, which can be made again with other parameters.

    Attributes:
        made: the scene.
        run: a simulation that stands at the last step.
        tape: of its steps.
    """

    def __init__(self, kind: Kind, change: Callable[[Made], None] = lambda made: None) -> None:
        at = Description(SAME, MPI.COMM_SELF)
        self.made = kind.make(at)
        change(self.made)
        absolute = ROUND_OFF_FORCES.get(kind.name, 0.0)
        tolerances = gx.Tolerances(relative=1e-13, absolute=absolute)
        stepper = gx.Midpoint(dt=kind.dt, tolerances=tolerances)
        self.run = gx.Simulation(gx.Scene(*at.in_order(self.made.parts)), stepper)
        self.tape = gx.analysis.RunTape(self.run)
        self.run.run(until=STEPS * kind.dt)
        self._dt = kind.dt

    def values(self, results: Sequence[Any]) -> Array:
        """The results in the present state."""
        return np.array([one(self.run) for one in results])

    def start(self) -> None:
        """Go back to the first state."""
        self.tape.restore(self.tape.states[0])
        self.run.system.unknowns.increment.remainder.set(0.0)

    def again(self) -> None:
        """Make the steps again from the present state at the start, without a record of them."""
        solver = self.run.solver
        for k in range(1, STEPS + 1):
            solver.accept(solver.step(self._dt))
            # Without the round-off of a sum.
            self.run.system.unknowns.time = k * self._dt


def changes_of(values: Array) -> Array:
    """A change (k,) of values that has their size, and no symmetry that could hide an error."""
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    return size * np.cos(1.0 + 0.7 * np.arange(len(values)))


def waves_of(values: Array) -> Array:
    """A smooth change (3n,) [m] of the positions (3n,) [m] of nodes, of their size."""
    X = values.reshape(-1, 3)
    size = float(np.abs(X).max())
    waves = np.sin(X @ np.array([[7, 5, 4], [3, -2, 6], [1, 8, 2]]) / size)
    return size * waves.ravel()


@contextmanager
def changed(system: Any, variable: Variable, values: Array) -> Iterator[None]:
    """Other values of a parameter for a while."""
    given = variable.get()
    variable.set(values)
    system.parameters_changed()
    try:
        yield
    finally:
        variable.set(given)
        system.parameters_changed()


def disagreement(derivatives: Array, change: Array, differences: Array, noise: Array) -> str:
    """In which results derivatives (results, k) along a change (k,) are not the differences
    (results,), in words; empty if they all are."""
    along = derivatives @ change
    sizes = np.abs(derivatives) @ np.abs(change)
    wrong = ~(np.abs(along - differences) <= DEVIATION * sizes + noise)
    return "; ".join(
        f"result {k}: {along[k]:.6e} for {differences[k]:.6e} (size {sizes[k]:.1e}, "
        f"noise {noise[k]:.1e})"
        for k in np.flatnonzero(wrong)
    )


def noise_of(results: Sequence[Any], values: Array, made: Made, dt: float, size: float) -> Array:
    """Round-off of results (n,): of velocities that of positions over a step [s]."""
    noise = np.abs(values)
    for k, one in enumerate(results):
        if isinstance(one, gx.probes.Position | gx.probes.Displacement):
            noise[k] = size
        if isinstance(one, gx.probes.Velocity):
            noise[k] = size / dt
        if isinstance(one, gx.analysis.EnclosedVolume):
            noise[k] = size**3
    return NOISE * noise


# ---- runs ----------------------------------------------------------------------------------------


def variables_of(recorded: RecordedRun) -> dict[str, Variable]:
    """Parameters of a run by which results may have derivatives, by their names."""
    system = recorded.run.system
    scalars = BackwardSteps(recorded.tape).scalars.parts
    refuse_unknown_kinds(system)
    found = {}
    for item in system.unknowns.items:
        for what in _names_of(system, item, True, scalars):
            name = f"{item.name}.{what}"
            try:
                (found[name],) = find_variables(
                    system, [name], AdjointFields(system), in_time=True, scalars=scalars
                )
            except gx.InputError as refusal:
                assert name in str(refusal)
    return found


def difference_in_time(
    kind: Kind, recorded: RecordedRun, results: Sequence[Any], variable: Variable, change: Array
) -> Array | None:
    """Differences of results (n,) of runs with a parameter that differs by ± a change; None if the
    scene allows no such change."""
    item_name, _, what = variable.name.rpartition(".")
    system = recorded.run.system
    ends = []
    for side in (1, -1):
        recorded.start()
        if what == INITIAL_POSITION:

            def displace(made: Made, side: int = side) -> None:
                """What the history has at the start, e.g. of folds beyond their yield angle,
                follows from the positions."""
                body = named(made.parts, item_name)
                positions, velocities = body.initial_state()
                moved = positions + side * change
                object.__setattr__(body, "initial_state", lambda: (moved, velocities))

            try:
                other = RecordedRun(kind, displace)
            except gx.InputError as torn:
                # The scene has no such change.
                assert "coincide" in str(torn) or "lie on it" in str(torn)
                return None
            ends.append(other.values(results_like(results, other.made)))
            continue
        if what == INITIAL_VELOCITY:
            (body,) = (one for one in system.unknowns.bodies if one.name == item_name)
            system.unknowns.v0.array[system.unknowns.block(body).owned] += side * change
            recorded.again()
            ends.append(recorded.values(results))
            continue
        if what in (SPIN, VELOCITY):
            (body,) = (one for one in system.unknowns.bodies if one.name == item_name)
            owned = system.unknowns.block(body).owned
            start = system.unknowns.q0.array_r[owned].reshape(4, 3)
            rates = np.zeros((4, 3))
            if what == SPIN:
                rates[1:] = np.cross(side * change, start[1:])
            else:
                rates[0] = side * change
            system.unknowns.v0.array[owned] += rates.ravel()
            recorded.again()
            ends.append(recorded.values(results))
            continue
        with changed(system, variable, variable.get() + side * change):
            recorded.start()
            recorded.again()
            ends.append(recorded.values(results))
    recorded.start()
    recorded.again()
    return (ends[0] - ends[1]) / 2


def difference_of_gas(kind: Kind, results: Sequence[Any], name: str, change: float) -> Array:
    """Differences of results (n,) of runs whose gas differs by ± a change of a number, which is
    taken when the scene is made."""
    item_name, _, what = name.rpartition(".")
    ends = []
    for side in (1, -1):

        def other(made: Made, side: int = side) -> None:
            item = named(made.parts, item_name)
            attribute = what if hasattr(item, what) else f"initial_{what}"
            if what in ("volume", "dead_volume"):
                attribute = "fixed_volume"
            object.__setattr__(item, attribute, getattr(item, attribute) + side * change)

        recorded = RecordedRun(kind, other)
        ends.append(recorded.values(results_like(results, recorded.made)))
    return (ends[0] - ends[1]) / 2


def allowed_by(source: Any, names: Sequence[str]) -> list[str]:
    """Those of the parameters of a tape or an equilibrium by which the energy has a gradient;
    others are refused in words."""
    try:
        gx.analysis.gradient(source, of=gx.analysis.Energy(), by=names)
    except gx.InputError as refusal:
        assert "gradient" in str(refusal)
    else:
        return list(names)
    if len(names) <= 1:
        return []
    half = len(names) // 2
    return [*allowed_by(source, names[:half]), *allowed_by(source, names[half:])]


@pytest.mark.parametrize("kind", IN_TIME, ids=lambda kind: kind.name)
def test_every_derivative_of_a_run_agrees_with_differences_or_is_refused(kind: Kind) -> None:
    recorded = RecordedRun(kind)
    system = recorded.run.system
    results = results_of(recorded.made, True)
    try:
        variables = variables_of(recorded)
    except gx.InputError as refusal:
        # Of some kinds no derivative is known: the reason begins with the name of the part.
        assert any(f"'{part.name}" in str(refusal) for part in recorded.made.parts)
        return
    names = list(variables)
    allowed = allowed_by(recorded.tape, names)
    # One object for all results: forms are derived once.
    gradients_by_all = TransientGradients(recorded.tape, allowed)
    of_results = [(one, gradients_by_all.of(one)) for one in results]
    found = {name: [gradient[name] for _, gradient in of_results] for name in allowed}
    notes = of_results[0][1].notes
    size = float(system.unknowns.initial.extent())
    noise = noise_of(results, recorded.values(results), recorded.made, kind.dt, size)
    compared = 0
    for name, gradients in found.items():
        what = name.rpartition(".")[2]
        is_of_gas = isinstance(variables[name], ScalarVariable)
        derivatives = np.array([np.ravel(one.values) for one in gradients])
        step = STEPS_OF.get(what, STEP)
        words = "not compared"
        for _ in range(1 + REFINEMENTS):
            try:
                if is_of_gas:
                    change = np.array([step * variables[name].get()[0]])
                    differences = difference_of_gas(kind, results, name, change[0])
                else:
                    change = step * direction(recorded, name, variables[name])
                    differences = difference_in_time(
                        kind, recorded, results, variables[name], change
                    )
                if differences is None:
                    words = ""
                    break
                words = disagreement(derivatives, change, differences, noise)
            except NotConverged as reason:
                # The last digits are asked for: not all changed runs have them.
                words = str(reason)
            if not words:
                break
            step /= 10
        # What has a kink at the start is said, and is not one number.
        is_noted = what in STARTS and any("has a kink" in note for note in notes)
        assert not words or is_noted, f"{kind.name}: {name}: {words}"
        compared += not words
    assert compared > 0


def direction(recorded: RecordedRun, name: str, variable: Variable) -> Array:
    """A change (k,) of a parameter of a run, of the size of its values, that the scene allows."""
    item_name, _, what = name.rpartition(".")
    system = recorded.run.system
    values = np.ravel(variable.get()).astype(float)
    if what not in (INITIAL_VELOCITY, INITIAL_POSITION, SHAPE):
        return changes_of(values)
    if what == SHAPE:
        return waves_of(values)
    (body,) = (one for one in system.unknowns.bodies if one.name == item_name)
    change = changes_of(values)
    held = np.zeros(system.unknowns.numbering.size_local, dtype=bool)
    held[system.unknowns.supports.held] = True
    change[held[system.unknowns.block(body).owned]] = 0.0
    return change


# ---- equilibria ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", AT_REST, ids=lambda kind: kind.name)
def test_every_derivative_of_an_equilibrium_agrees_with_differences_or_is_refused(
    kind: Kind,
) -> None:
    at = Description(SAME, MPI.COMM_SELF)
    made = kind.make(at)
    search = gx.analysis.Continuation(tolerance=1e-12)
    equilibrium = gx.Equilibrium(gx.Scene(*made.parts), search)
    equilibrium.find(progress=False)
    system = equilibrium.system
    results = results_of(made, in_time=False)

    def found_again() -> Array:
        equilibrium.find(progress=False)
        return np.array([one(equilibrium) for one in results])

    present = found_again()
    size = float(system.unknowns.initial.extent())
    # Round-off of the forces of stiff film moves soft film by more than the round-off of positions.
    noise = 1e4 * noise_of(results, present, made, 1.0, size)
    compared = 0
    for item in system.unknowns.items:
        for what in _names_of(system, item, False, ()):
            name = f"{item.name}.{what}"
            try:
                (variable,) = find_variables(system, [name], AdjointFields(system), in_time=False)
                gradients = [
                    gx.analysis.gradient(equilibrium, of=one, by=[name])[name] for one in results
                ]
            except gx.InputError as refusal:
                assert "gradient" in str(refusal)
                continue
            derivatives = np.array([np.ravel(one.values) for one in gradients])
            values = np.ravel(variable.get())
            change = changes_of(values)
            if what == SHAPE:
                change = waves_of(values)
            change *= STEP if what != SHAPE else 1e-3 * STEP
            ends = []
            for side in (1, -1):
                with changed_at_rest(equilibrium, variable, values + side * change):
                    ends.append(found_again())
            found_again()
            words = disagreement(derivatives, change, (ends[0] - ends[1]) / 2, noise)
            assert not words, f"{kind.name}: {name}: {words}"
            compared += 1
    assert compared > 3


@contextmanager
def changed_at_rest(equilibrium: Any, variable: Variable, values: Array) -> Iterator[None]:
    """Other values of a parameter of an equilibrium for a while."""
    given = variable.get()
    for now in (values, given):
        variable.set(now)
        for compiled in equilibrium.system.equations.differentiable:
            compiled.parameters_changed()
        if now is values:
            yield


# ---- other descriptions --------------------------------------------------------------------------

# Turned, moved, in other units, in another order and numbering; names of cut bodies are others.
OTHERWISE = replace(ALL_AT_ONCE, is_split=False)


def logarithmic_derivatives(kind: Kind, transformation: Transformation) -> dict[str, float]:
    """Σ θ dE/dθ [J] of the energy E of a scene for each parameter θ that has no origin."""
    at = Description(transformation.without(kind.left_out), MPI.COMM_SELF)
    made = kind.make(at)
    scene = gx.Scene(*at.in_order(made.parts))
    source: Any
    if kind.dt == 0:
        source = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-12))
        source.find(progress=False)
        scalars = ()
    else:
        tolerances = gx.Tolerances(relative=1e-13)
        run = gx.Simulation(scene, gx.Midpoint(dt=at(kind.dt, "s"), tolerances=tolerances))
        source = gx.analysis.RunTape(run)
        run.run(until=at(STEPS * kind.dt, "s"))
        scalars = BackwardSteps(source).scalars.parts
    system = source.system
    names = [
        f"{item.name}.{what}"
        for item in system.unknowns.items
        # Potentials of loads count from the origin.
        if "gravity" not in item.name
        for what in _names_of(system, item, kind.dt > 0, scalars)
        if what not in (SHAPE, INITIAL_POSITION)
    ]
    found = dict.fromkeys(names, math.nan)
    allowed = allowed_by(source, names)
    if not allowed:
        return found
    gradient = gx.analysis.gradient(source, of=gx.analysis.Energy(), by=allowed)
    variables = find_variables(
        system, allowed, AdjointFields(system), in_time=kind.dt > 0, scalars=scalars
    )
    for variable in variables:
        values = np.ravel(gradient[variable.name].values)
        found[variable.name] = at.written(float(values @ np.ravel(variable.get())), "J")
    return found


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_derivatives_do_not_depend_on_the_description(kind: Kind) -> None:
    as_written = logarithmic_derivatives(kind, SAME)
    otherwise = logarithmic_derivatives(kind, OTHERWISE)
    assert otherwise.keys() == as_written.keys()
    size = max((abs(value) for value in as_written.values() if not math.isnan(value)), default=0.0)
    for name, value in as_written.items():
        expected = pytest.approx(value, rel=1e-5, abs=1e-7 * size, nan_ok=True)
        assert otherwise[name] == expected, name
