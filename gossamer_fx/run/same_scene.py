"""Whether a checkpoint is of the scene that is to go on from it: parts, unknowns, meshes, parameters, energies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import is_on_mesh
from gossamer_fx.probes.run import Run
from gossamer_fx.run.node_keys import mesh_name
from gossamer_fx.run.parameters import difference, of_item, unknown
from gossamer_fx.system.totals import Totals
from gossamer_fx.terms.scalar_unknowns import InitialCondition

SAME = 1e-6  # largest relative difference of an energy that is computed anew: round-off, but no other parameter
_TOLD = 80  # characters of a value in a message

Description = dict[str, Any]


def scene_of(run: Run, events: list[Description]) -> Description:
    """What tells scenes apart, at the start of a run; the same on any number of ranks."""
    system, meshes, extents = run.system, dict[str, int](), dict[str, list[float]]()
    for body in system.bodies:
        if is_on_mesh(body):
            geometry = body.space.mesh.geometry
            x = geometry.x[: geometry.index_map().size_local]
            meshes[body.name] = mesh_name(body)
            extents[body.name] = run.comm.allreduce(
                np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)])
            ).tolist()
    items = run.scene.items
    return {
        "parts": sorted(f"{type(item).__name__} '{item.name}'" for item in items),
        "unknowns": [block.index_map.size_global * block.size for block in system.numbering.blocks],
        "meshes": meshes,
        "extents": extents,
        "parameters": {
            i.name: of_item(i, items) for i in items if not isinstance(i, InitialCondition)
        },
        "events": events,
        "stepper": type(run.stepper).__name__,
        "vectors": sorted(run.history.vectors),
    }


def compare(path: Path, there: Description, here: Description, changes: Sequence[str]) -> str:
    """Refuse a checkpoint of another scene; returns what could not be compared.

    Args:
        path: of the checkpoint.
        there, here: the scene that wrote it, and this one.
        changes: names of parts and events whose parameters are meant to be others.
    """
    before = f"The checkpoint '{path}' is of another scene: "
    lost = sorted(set(there["parts"]) ^ set(here["parts"]))
    check(
        not lost,
        f"{before}{lost[0] if lost else ''} is only in one of them; restart the scene that wrote it.",
    )
    for body in here["meshes"]:
        same = there["meshes"].get(body) == here["meshes"][body] and np.allclose(
            there["extents"][body],
            here["extents"][body],
            rtol=1e-9,
            atol=1e-9 * max(map(abs, here["extents"][body])),
        )
        check(
            same,
            f"{before}the mesh of '{body}' is not the same; read the mesh with which it was written.",
        )
    counts = there["unknowns"], here["unknowns"]
    check(
        counts[0] == counts[1],
        f"{before}it has {sum(counts[0])} unknowns, this one {sum(counts[1])}; use its order.",
    )
    control = there["stepper"] == here["stepper"] and there["vectors"] == here["vectors"]
    check(
        control,
        f"{before}it was stepped by {there['stepper']}, with another control; take the same stepper.",
    )
    events = [event["name"] for event in here["events"]]
    names = [*here["parameters"], *events]
    strange = next((name for name in changes if name not in names), None)
    check(
        strange is None,
        f"changes holds '{strange}', but the scene has no such part; it has: {', '.join(names)}.",
    )
    for name, parameters in here["parameters"].items():
        _compare_parameters(
            before, f"of '{name}'", there["parameters"][name], parameters, name in changes
        )
    _compare_events(before, there["events"], here["events"], changes)
    return _not_compared(here, changes)


def _compare_parameters(before: str, of: str, there: Any, here: Any, meant: bool) -> None:
    found = None if meant else difference(there, here)
    if found:
        place, one, other = found
        function = any(word in place.split() for word in ("code", "function", "outside"))
        what = f"the function {place.split()[0]} {of} is another one" if function else ""
        what = what or f"{place} {of} is {_shown(one)} there and {_shown(other)} here"
        check(False, f"{before}{what}; restart with the same, or name it in changes.")


def _shown(value: Any) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= _TOLD else f"{text[:_TOLD]}..."


def _compare_events(
    before: str, there: Iterable[Description], here: Iterable[Description], changes: Sequence[str]
) -> None:
    """Events may come in another order."""
    left = list(there)
    for event in here:
        found = next((e for e in left if e["key"] == event["key"]), None)
        known = found is not None or event["name"] in changes
        check(
            known,
            f"{before}the event {event['key']} is not in it; restart with the same, or name it in changes.",
        )
        if found is not None:
            left.remove(found)
            _compare_parameters(
                before, f"of the event '{event['name']}'", found, event, event["name"] in changes
            )
    gone = next((e["key"] for e in left if e["name"] not in changes), None)
    check(gone is None, f"{before}the event {gone} is missing here; restart with the same events.")


def _not_compared(here: Description, changes: Sequence[str]) -> str:
    """In words: what functions take from outside, and what is not known otherwise."""
    places = [
        f"{place} of '{name}'"
        for name, parameters in here["parameters"].items()
        if name not in changes
        for place in unknown(parameters)
    ]
    places += [
        f"{place} of '{event['name']}'" for event in here["events"] for place in unknown(event)
    ]
    return ", ".join(
        [*dict.fromkeys(places), *(f"'{name}', which is meant to change" for name in changes)]
    )


def compare_energies(path: Path, here: Totals, there: Mapping[str, Any]) -> None:
    """Refuse a checkpoint whose energies these parameters do not give."""
    ours = {"kinetic": here.kinetic, **here.stored}
    theirs = {"kinetic": there["kinetic"], **there["stored"]}
    largest = max(abs(e) for e in theirs.values())
    for name, energy in ours.items():
        same = abs(energy - theirs.get(name, np.inf)) <= SAME * abs(energy) + 1e-9 * largest
        check(
            same,
            f"The checkpoint '{path}' is of another scene: the energy '{name}' is {theirs.get(name, 0.0):.6g} J there "
            f"and {energy:.6g} J here; restart with the same materials and gas.",
        )
