"""Comparison of a scene with that of the checkpoint from which it is to be restarted.

Problem.  A restart with another mesh, law or load would give wrong results without an error.

Compared are names and kinds of the items, meshes, numbers of unknowns, the stepper, the arguments
of items and events (see `outputs.arguments`), and, in the restored state, the energies.  Initial
conditions are not compared: the state of the checkpoint replaces them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import is_on_mesh
from gossamer_fx.records.outputs.arguments import MEASURED, TOLERANCE, Known, arguments_of
from gossamer_fx.records.run.node_keys import mesh_name
from gossamer_fx.solve.steppers.history import History
from gossamer_fx.solve.steppers.stepping import Stepper
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import StateView

# Relative difference of arguments that counts as round-off: a script that is run again computes the
# same numbers, on another machine up to the last digits.
SAME_ARGUMENT = 1e-9

# The same for a component of a vector, over the vector's largest one: a cosine of π/2 is 6e-17, or
# zero.
SAME_COMPONENT = 1e-15

# The same for an energy that is computed again from the coordinates: sums over other ranks are in
# another order, and the strains of a stiff film are small differences.
SAME_ENERGY = 1e-6

# An energy may differ by this fraction of the largest energy: a small one may be all round-off.
NEGLIGIBLE_ENERGY = 1e-9

# Characters of a value in a message: an array would fill the screen.
MAX_SHOWN = 80

Description = dict[str, Any]


def scene_of(
    run: StateView, stepper: Stepper, history: History, events: Mapping[str, Description]
) -> Description:
    """Describe a scene for the comparison, as data for JSON that is the same on any number of
    ranks; `events` by their keys.  Collective.
    """
    meshes: dict[str, Any] = {}
    for body in run.system.bodies:
        if is_on_mesh(body):
            geometry = body.space.mesh.geometry
            x = geometry.x[: geometry.index_map().size_local]
            # The name covers the cells; the moments of the points notice a mesh of another size.
            moments = np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)])
            meshes[body.name] = [mesh_name(body), run.comm.allreduce(moments).tolist()]
    items = run.scene.items
    blocks = run.system.numbering.blocks
    return {
        # Sorted, as the order of items does not matter.
        "parts": sorted(f"{type(item).__name__} '{item.name}'" for item in items),
        "meshes": meshes,
        "unknowns": [block.index_map.size_global * block.size for block in blocks],
        "stepping": [type(stepper).__name__, sorted(history.vectors)],
        "arguments": arguments_of(items),
        "events": events,
    }


def compare(path: Path, there: Description, here: Description, changes: Sequence[str]) -> None:
    """Raise `InputError` unless the description of this scene is that of a checkpoint, but for the
    items and events that are named in `changes`."""
    refusal = f"The checkpoint '{path}' is of another scene: "
    # The order of the checks is that of their causes: another item also changes the unknowns.
    unmatched = sorted(set(there["parts"]) ^ set(here["parts"]))
    check(
        not unmatched,
        f"{refusal}{''.join(unmatched[:1])} is only in one of them; restart the scene that wrote "
        "it.",
    )
    for body, mesh in here["meshes"].items():
        check(
            next(differences(there["meshes"].get(body), mesh), None) is None,
            f"{refusal}the mesh of '{body}' is not the same; read the mesh with which it was "
            "written.",
        )
    check(
        there["unknowns"] == here["unknowns"],
        f"{refusal}it has {sum(there['unknowns'])} unknowns, this one {sum(here['unknowns'])}; use "
        "its order.",
    )
    check(
        there["stepping"] == here["stepping"],
        f"{refusal}it was stepped by {there['stepping'][0]}, with another control; take the same "
        "stepper.",
    )
    known = [*here["arguments"], *(event["name"] for event in here["events"].values())]
    # A misspelt name would let a difference pass as an error of the scene.
    for name in changes:
        check(
            name in known,
            f"changes holds '{name}', but the scene has no such part; it has: {', '.join(known)}.",
        )
    for key, arguments in here["arguments"].items():
        if key not in changes:
            _refuse_difference(refusal, f"'{key}'", there["arguments"][key], arguments)
    for key in sorted(there["events"].keys() | here["events"].keys()):
        one = there["events"].get(key)
        other = here["events"].get(key)
        if (other or one)["name"] in changes:
            continue
        check(
            bool(one and other),
            f"{refusal}the event {key} is only in one of them; restart with the same, or name it "
            "in changes.",
        )
        _refuse_difference(refusal, f"the event {key}", one, other)


def _refuse_difference(refusal: str, owner: str, there: Known, here: Known) -> None:
    """Raise `InputError` for the first difference between the arguments of an item or event, with
    both values."""
    for words, one, other in differences(there, here):
        check(
            False,
            f"{refusal}{' '.join(words)} of {owner} is {_shown(one)} there and {_shown(other)} "
            "here; restart with the same, or name it in changes.",
        )


def differences(
    there: Known, here: Known, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Known, Known]]:
    """Yield all differences of two descriptions: the names that lead to them, and both values.

    Numbers count as equal if they differ by less than 1e-9 of their size.
    """
    if isinstance(there, dict) and isinstance(here, dict):
        # A position that was computed has a known error, which its description states.
        if MEASURED in there and MEASURED in here:
            if not np.allclose(there[MEASURED], here[MEASURED], rtol=0.0, atol=here[TOLERANCE]):
                yield words, there[MEASURED], here[MEASURED]
            return
        # The class comes first: of objects of two classes, all arguments differ.
        for key in sorted(there.keys() | here.keys(), key=lambda key: (key != "class", key)):
            yield from differences(there.get(key), here.get(key), (*words, key))
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        if all(map(_is_number, [*there, *here])):
            if not _same_numbers(there, here):
                yield words, there, here
            return
        for k, (one, other) in enumerate(zip(there, here, strict=True)):
            # Only of several objects does the message need the number, from one.
            is_numbered = isinstance(one, dict) and len(there) > 1
            yield from differences(one, other, (*words, str(k + 1)) if is_numbered else words)
    elif _is_number(there) and _is_number(here):
        if not _same_numbers([there], [here]):
            yield words, there, here
    elif there != here:
        yield words, there, here


def _is_number(value: Known) -> bool:
    """Whether a value is a number; Python counts True and False as integers."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _same_numbers(there: Sequence[float], here: Sequence[float]) -> bool:
    """Whether numbers are equal up to round-off; two NaN are equal."""
    expected = np.array(there, dtype=float)
    largest = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
    # The tolerance is relative only, since an area may be as small as 1e-13 m².
    return np.allclose(
        here, expected, rtol=SAME_ARGUMENT, atol=SAME_COMPONENT * largest, equal_nan=True
    )


def _shown(value: Known) -> str:
    """A value for a message, of `MAX_SHOWN` characters at most."""
    text = repr(value)
    if isinstance(value, float):
        # As many digits as are compared.
        text = f"{value:.9g}"
    if len(text) > MAX_SHOWN:
        return f"{text[:MAX_SHOWN]}..."
    return text


def compare_energies(path: Path, here: Totals, there: Mapping[str, Any]) -> None:
    """Check that this scene has the energies [J] of the checkpoint in the same state.

    This finds differences that a comparison of arguments cannot see, e.g. inside a law of the user.
    """
    ours = {"kinetic": here.kinetic, **here.stored}
    theirs = {"kinetic": there["kinetic"], **there["stored"]}
    largest = max(abs(energy) for energy in theirs.values())
    for name, energy in ours.items():
        tolerance = SAME_ENERGY * abs(energy) + NEGLIGIBLE_ENERGY * largest
        check(
            abs(energy - theirs.get(name, np.inf)) <= tolerance,
            f"The checkpoint '{path}' is of another scene: the energy '{name}' is "
            f"{theirs.get(name, 0.0):.6g} J there and {energy:.6g} J here; restart with the same "
            "materials and gas.",
        )
