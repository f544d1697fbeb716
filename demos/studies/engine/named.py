"""Studies by the names of their modules, as workers of an executor import them."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from demos.studies.engine.spreads import SpreadStudy
from demos.studies.engine.study import Study


def study_of(name: str) -> Study | SpreadStudy:
    """The study of a module of `demos/studies`."""
    return importlib.import_module(f"demos.studies.{name}").STUDY


def outcome_of(name: str, comm: MPI.Intracomm, folder: Path, **values: Any) -> Mapping[str, float]:
    """The outcome of a case of a study."""
    return study_of(name).outcome(comm, folder, **values)
