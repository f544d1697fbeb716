"""What outputs of fields have in common: a path, a body, names of fields, and when they are due."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import MeshBody, is_on_mesh
from gossamer_fx.records.outputs.schedule import Schedule
from gossamer_fx.solve.view import Run


class FieldOutput:
    """Fields of one body in files of one format.

    Args:
        path: of the file, with the ending of the format.
        body: a body on a mesh; None if the scene has just one.
        fields: names, see `gx.fields`.
        every: steps between two records.
        times: at which fields are recorded instead [s].

    Attributes:
        ending: of the format, with its dot.
        last_time: of the last record [s]; None before the first.

    Raises:
        InputError: the path has another ending, or `fields` is a word.
    """

    ending: ClassVar[str]

    def __init__(
        self,
        path: str | Path,
        body: MeshBody | None,
        fields: Sequence[str],
        every: int,
        times: Sequence[float],
    ) -> None:
        self.path = Path(path)
        self.body = body
        self.fields = fields
        self.schedule = Schedule(every, tuple(times))
        kind = type(self).__name__
        check(
            self.path.suffix == self.ending,
            f"{kind} cannot write '{path}'; give a name that ends in {self.ending}.",
        )
        check(
            not isinstance(fields, str),
            f"{kind} '{path}': fields is {fields!r}; give a tuple of names, ({fields!r},).",
        )
        self.last_time: float | None = None

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    def chosen_body(self, run: Run) -> MeshBody:
        """The body whose fields are recorded: the given one, else the only one on a mesh.

        Args:
            run: with the bodies of the scene.

        Raises:
            InputError: the body is not in the scene, or none was given and the scene has several.
        """
        output = f"{type(self).__name__} '{self.path}'"
        bodies = [one for one in run.system.bodies if is_on_mesh(one)]
        names = ", ".join(f"'{one.name}'" for one in bodies) or "none"
        if self.body is None:
            check(
                len(bodies) == 1,
                f"{output}: say which body is meant; those on a mesh are: {names}.",
            )
            return bodies[0]
        check(
            self.body in bodies,
            f"{output}: '{self.body.name}' is not a body of the scene on a mesh; those are: "
            f"{names}.",
        )
        return self.body
