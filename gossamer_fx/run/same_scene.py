"""Whether a checkpoint was written by the scene that is to go on from it.

Compared are the kinds and names of the scene's items, the numbers of unknowns, the meshes, the arguments of every item
(see `outputs.arguments`), the events, the kind of stepper, and the energies of the scene in the checkpoint's state.
Initial conditions such as `StartFrom` are not compared: the state of the checkpoint replaces them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import is_on_mesh
from gossamer_fx.outputs.arguments import (
    MEASURED,
    TOLERANCE,
    UNKNOWN,
    Known,
    arguments_of,
    unknown,
)
from gossamer_fx.probes.run import Run
from gossamer_fx.run.node_keys import mesh_name
from gossamer_fx.system.totals import Totals

# Relative difference of arguments that counts as round-off: a script that is run again computes the same numbers, on
# another machine up to the last digits.
SAME_ARGUMENT = 1e-9
# Relative difference of a component of a vector, over the vector's largest one: a cosine of π/2 is 6e-17, or zero.
SAME_COMPONENT = 1e-15
# Relative difference of an energy that is computed again from the coordinates: sums on other ranks
# are in another order, and the strains of a stiff film are small differences.
SAME_ENERGY = 1e-6
# Of the largest energy: what a smaller energy may differ by.
NEGLIGIBLE_ENERGY = 1e-9
MAX_SHOWN = 80  # characters of a value in a message
# Keys of the description of a function, see `outputs.arguments`.
FUNCTION_PARTS = ("function", "constants", "names", "defaults", "outside", "with")

Description = dict[str, Any]


@dataclass(frozen=True)
class Difference:
    """Where two descriptions differ: the words that lead there, and the values; None: it is only in the other."""

    words: tuple[str, ...]
    there: Known
    here: Known


def scene_of(run: Run, events: list[Description]) -> Description:
    """What distinguishes a scene from others, at the start of a run; the same on any number of ranks.

    Args:
        run: at its start.
        events: see `EventMonitor.describe`.
    """
    meshes: dict[str, int] = {}
    extents: dict[str, list[float]] = {}
    for body in run.system.bodies:
        if is_on_mesh(body):
            geometry = body.space.mesh.geometry
            x = geometry.x[: geometry.index_map().size_local]
            moments = np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)])
            meshes[body.name] = mesh_name(body)
            extents[body.name] = run.comm.allreduce(moments).tolist()
    items = run.scene.items
    return {
        "parts": sorted(f"{type(item).__name__} '{item.name}'" for item in items),
        "unknowns": [
            block.index_map.size_global * block.size for block in run.system.numbering.blocks
        ],
        "meshes": meshes,
        "extents": extents,
        "arguments": arguments_of(items),
        "events": events,
        "stepper": type(run.stepper).__name__,
        "vectors": sorted(run.history.vectors),
    }


def compare(path: Path, there: Description, here: Description, changes: Sequence[str]) -> str:
    """Refuse a checkpoint of another scene; returns what could not be compared, in words.

    Args:
        path: of the checkpoint.
        there: the scene that wrote the checkpoint, see `scene_of`.
        here: this scene.
        changes: names of items and events whose arguments are meant to be others.

    Raises:
        InputError: the first difference, with both values; `changes` names something that the scene does not have.
    """
    refusal = f"The checkpoint '{path}' is of another scene: "
    lonely = sorted(set(there["parts"]) ^ set(here["parts"]))
    check(
        not lonely,
        f"{refusal}{''.join(lonely[:1])} is only in one of them; restart the scene that wrote it.",
    )
    _compare_meshes(refusal, there, here)
    check(
        there["unknowns"] == here["unknowns"],
        f"{refusal}it has {sum(there['unknowns'])} unknowns, this one {sum(here['unknowns'])}; use its order.",
    )
    check(
        there["stepper"] == here["stepper"] and there["vectors"] == here["vectors"],
        f"{refusal}it was stepped by {there['stepper']}, with another control; take the same stepper.",
    )
    known = [*here["arguments"], *(event["name"] for event in here["events"])]
    strange = next((name for name in changes if name not in known), None)
    check(
        strange is None,
        f"changes holds '{strange}', but the scene has no such part; it has: {', '.join(known)}.",
    )
    for name, arguments in here["arguments"].items():
        if name not in changes:
            _refuse_difference(refusal, f"'{name}'", there["arguments"][name], arguments)
    _compare_events(refusal, there["events"], here["events"], changes)
    return _not_compared(here, changes)


def _compare_meshes(refusal: str, there: Description, here: Description) -> None:
    for body, name in here["meshes"].items():
        ours = here["extents"][body]
        theirs = there["extents"][body]
        tolerance = SAME_ARGUMENT * max(map(abs, ours))
        same_place = np.allclose(theirs, ours, rtol=SAME_ARGUMENT, atol=tolerance)
        check(
            there["meshes"].get(body) == name and same_place,
            f"{refusal}the mesh of '{body}' is not the same; read the mesh with which it was written.",
        )


def _compare_events(
    refusal: str, there: Iterable[Description], here: Iterable[Description], changes: Sequence[str]
) -> None:
    """Compare events, which may come in another order."""
    left = list(there)
    for event in here:
        found = next((other for other in left if other["key"] == event["key"]), None)
        meant = event["name"] in changes
        check(
            found is not None or meant,
            f"{refusal}the event {event['key']} is not in it; restart with the same, or name it in changes.",
        )
        if found is not None:
            left.remove(found)
            if not meant:
                _refuse_difference(refusal, f"the event '{event['name']}'", found, event)
    gone = next((event["key"] for event in left if event["name"] not in changes), None)
    check(gone is None, f"{refusal}the event {gone} is missing here; restart with the same events.")


def _refuse_difference(refusal: str, owner: str, there: Known, here: Known) -> None:
    """Raise `InputError` for the first difference between the arguments of an item or event."""
    found = next(differences(there, here), None)
    if found is None:
        return
    values = f"{_shown(found.there)} there and {_shown(found.here)} here"
    what = f"{' '.join(found.words)} of {owner} is {values}"
    inside = next((k for k, word in enumerate(found.words) if word in FUNCTION_PARTS), None)
    if inside:
        name = " ".join(found.words[:inside])
        part = " ".join(found.words[inside:])
        what = f"the function {name} of {owner} is another one ({part}: {values})"
    check(False, f"{refusal}{what}; restart with the same, or name it in changes.")


def differences(there: Known, here: Known, words: tuple[str, ...] = ()) -> Iterator[Difference]:
    """All differences of two descriptions, but where one is unknown on both sides."""
    if isinstance(there, dict) and isinstance(here, dict):
        yield from _differences_of_dicts(there, here, words)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        if all(map(_is_number, [*there, *here])):
            if not _same_numbers(there, here):
                yield Difference(words, there, here)
        else:
            for k, (one, other) in enumerate(zip(there, here, strict=True)):
                numbered = isinstance(one, dict) and len(there) > 1
                yield from differences(one, other, (*words, str(k + 1)) if numbered else words)
    elif _is_number(there) and _is_number(here):
        if not _same_numbers([there], [here]):
            yield Difference(words, there, here)
    elif there != here:
        yield Difference(words, there, here)


def _differences_of_dicts(
    there: Description, here: Description, words: tuple[str, ...]
) -> Iterator[Difference]:
    if UNKNOWN in there and UNKNOWN in here:
        return
    if MEASURED in there and MEASURED in here:
        near = np.allclose(there[MEASURED], here[MEASURED], rtol=0.0, atol=here[TOLERANCE])
        if not near:
            yield Difference(words, there[MEASURED], here[MEASURED])
        return
    # The class comes first: of objects of two classes, all arguments differ.
    for key in sorted(there.keys() | here.keys(), key=lambda key: (key != "class", key)):
        inside = (*words, key)
        if key in there and key in here:
            yield from differences(there[key], here[key], inside)
        else:
            yield Difference(inside, there.get(key), here.get(key))


def _is_number(value: Known) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _same_numbers(there: Sequence[float], here: Sequence[float]) -> bool:
    """Whether numbers are equal up to round-off; there is no absolute tolerance, since areas may be 1e-13 m²."""
    largest = max((abs(x) for x in (*there, *here) if math.isfinite(x)), default=0.0)
    for one, other in zip(there, here, strict=True):
        near = math.isclose(one, other, rel_tol=SAME_ARGUMENT, abs_tol=SAME_COMPONENT * largest)
        if not near and not (math.isnan(one) and math.isnan(other)):
            return False
    return True


def _shown(value: Known) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


def _not_compared(here: Description, changes: Sequence[str]) -> str:
    """In words: what functions take from outside, what is unknown otherwise, and what is meant to change."""
    places = [
        f"{place} of '{name}'"
        for name, arguments in here["arguments"].items()
        if name not in changes
        for place in unknown(arguments)
    ]
    places += [
        f"{place} of '{event['name']}'" for event in here["events"] for place in unknown(event)
    ]
    places = list(dict.fromkeys(place.strip() for place in places))
    return ", ".join([*places, *(f"'{name}', which is meant to change" for name in changes)])


def compare_energies(path: Path, here: Totals, there: Mapping[str, Any]) -> None:
    """Refuse a checkpoint whose energies this scene does not have in the same state.

    Args:
        path: of the checkpoint.
        here: energies of this scene in the state of the checkpoint.
        there: energies that the checkpoint holds.
    """
    ours = {"kinetic": here.kinetic, **here.stored}
    theirs = {"kinetic": there["kinetic"], **there["stored"]}
    largest = max(abs(energy) for energy in theirs.values())
    for name, energy in ours.items():
        tolerance = SAME_ENERGY * abs(energy) + NEGLIGIBLE_ENERGY * largest
        check(
            abs(energy - theirs.get(name, np.inf)) <= tolerance,
            f"The checkpoint '{path}' is of another scene: the energy '{name}' is {theirs.get(name, 0.0):.6g} J there "
            f"and {energy:.6g} J here; restart with the same materials and gas.",
        )
