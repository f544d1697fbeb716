"""The quick forms of studies and validations end well, and every demo is run: ./gossamer test -m
slow tests/docs.

Demos are run by the tests of what they show, with coarse meshes and short times.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.design import robust_tube
from gossamer_fx.app.cli.demo import demos_of
from gossamer_fx.solve.scene import scene
from gossamer_fx.solve.scene.validation import warnings

ROOT = Path(gx.__file__).parent.parent
STUDIES = sorted(path.stem for path in (ROOT / "demos/studies").glob("*.py") if path.stem[0] != "_")
CASES = sorted(path.stem for path in (ROOT / "demos/validation/cases").glob("*.toml"))
# Those that no test imports; their tests run the program itself.
RUN_AS_PROGRAMS = {"pillow"}
DEMOS = demos_of(ROOT / "demos")
# It compares stored results of others; test_antenna.py runs its scenes.
WITHOUT_A_SCENE = {"antenna_reference"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "name"),
    [*(("studies", name) for name in STUDIES), *(("validation", name) for name in CASES)],
)
def test_a_quick_form_ends_as_it_declares(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], folder: str, name: str
) -> None:
    # In this process, as most of them take less time than a start of Python with dolfinx.
    main = importlib.import_module(f"demos.{folder}.__main__").main
    code = main([name, "--quick", "--out", str(tmp_path)])
    said = capsys.readouterr().out
    assert code == 0, said
    assert said.endswith(" comparisons are as declared.\n")
    if folder == "studies":
        # A table has more than ten cells, or the study has written none.
        assert (tmp_path / name / f"{name}.md").read_text(encoding="utf-8").count("|") > 10
    else:
        assert (tmp_path / f"{name}-quick" / f"{name}.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("start", robust_tube.CONTROL["start"])
def test_a_run_of_the_robust_design_starts(start: str) -> None:
    levels = robust_tube.SWEEP.cases()[0]
    case = robust_tube.build(MPI.COMM_SELF, **(levels | {"start": start, "panels": 3}))
    simulation = case.simulation([gx.Series(case.probes)])
    # Two or more steps of the start; the whole run takes an hour.
    simulation.run(until=1e-4)
    assert simulation.step > 0
    assert abs(simulation.energy_error) < 1e-9


class FirstScene(BaseException):
    """Ends a demo as soon as it has made a scene; no `Exception`, which a demo could catch."""


@pytest.mark.parametrize("name", sorted(set(DEMOS) - WITHOUT_A_SCENE))
def test_no_number_of_a_demo_is_in_an_unusual_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Of its first scene with its own numbers; the tests that run demos see the others."""
    words: list[str] = []

    def look(items: Iterable[Any], comm: MPI.Intracomm) -> None:
        words.extend(warning for warning in warnings(list(items)) if "unusual" in warning)
        raise FirstScene

    monkeypatch.setattr(scene, "validate", look)
    monkeypatch.chdir(tmp_path)
    demo = importlib.import_module(f"demos.{DEMOS[name].parent.name}.{name}")
    needed = [
        argument
        for argument, its in inspect.signature(demo.main).parameters.items()
        if its.default is its.empty and its.kind is not its.VAR_KEYWORD
    ]
    given = {"comm": MPI.COMM_SELF} if needed else {}
    with pytest.raises(FirstScene):
        demo.main(**given)
    assert words == []


def test_every_demo_is_run_by_a_test() -> None:
    tested = set(RUN_AS_PROGRAMS)
    for path in (ROOT / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                module = node.module or ""
                if module.startswith("demos."):
                    # from demos.sails import ikaros, or from demos.sails.ikaros import build
                    tested |= {alias.name for alias in node.names} | set(module.split(".")[2:])
    assert set(DEMOS) - tested == set()
