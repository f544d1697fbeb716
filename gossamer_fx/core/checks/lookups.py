"""Names, files and parts that have to be there: one sentence for each kind of error."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import check


def check_known(owner: str, what: str, name: object, known: Iterable[object]) -> None:
    """Raise `InputError` unless a name is one of those that are known.

    >>> check_known("The mesh", "group", "rim", ["rim", "hub"])
    """
    names = [str(one) for one in known]
    plural = f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
    check(
        name in names,
        f"{owner} has no {what} {name!r}; its {plural} are: {', '.join(names) or 'none'}.",
    )


def check_once(what: str, names: Collection[object]) -> None:
    """Raise `InputError` if a name occurs twice.

    >>> check_once("Feedback 'f': the actuator", ["x", "y"])
    """
    listed = list(names)
    twice = next((name for name in listed if listed.count(name) > 1), None)
    check(twice is None, f"{what} '{twice}' is given twice; give it once.")


def check_in_scene(part: str, is_in_scene: bool) -> None:
    """Raise `InputError` unless a part that is asked about is in the scene.

    >>> check_in_scene("Latch 'hinge'", True)
    """
    check(is_in_scene, f"{part} is not in the scene; add it.")


def check_no_contact(system: Any, user: str, why: str) -> None:
    """Raise `InputError` if a scene has contact; `why` the user cannot have it."""
    check(
        not system.equations.active_sets,
        f"{user}: the scene has contact, {why}; leave it out.",
    )


def check_no_gas(system: Any, user: str, why: str) -> None:
    """Raise `InputError` if a scene has gas chambers; `why` the user cannot have them."""
    check(
        not system.equations.scalar_unknowns,
        f"{user}: the scene has gas chambers, {why}; give their pressure as Pressure.",
    )


def check_midpoint(name: str, takes_mid_strain: bool) -> None:
    """Raise `InputError` if a stepper evaluates forces, which need both ends of a step, by the
    strain in its middle."""
    check(
        not takes_mid_strain,
        f"'{name}' has forces by the strains at the ends of a step; run its scene with Midpoint.",
    )


def check_file(path: Path | str, what: str, remedy: str) -> None:
    """Raise `InputError` unless there is a file; `what` it is, and the remedy if not."""
    check(Path(path).is_file(), f"There is no {what} '{path}'; {remedy}.")
