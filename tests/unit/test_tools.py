"""The tools of developers: arguments of the tests on two ranks, lint, site, packages from PyPI."""

from __future__ import annotations

import ast
import importlib
import json
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> object:
    """Imports a tool by its name, as when it is run."""

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    return load


class Children:
    """Replaces `run_child`: keeps the commands, and ends them with given codes."""

    def __init__(self, *codes: int) -> None:
        self.commands: list[list[str]] = []
        self._codes = list(codes)

    def __call__(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> int:
        self.commands.append(list(command))
        return self._codes.pop(0)


@pytest.mark.parametrize(
    ("words", "on_ranks"),
    [
        ([], ["-m", "mpi and not slow"]),
        (["tests/unit", "-x"], ["tests/unit", "-x", "-m", "mpi and not slow"]),
        (["-m", "slow"], ["-m", "mpi and (slow)"]),
        (["-mslow or gas", "a.py"], ["a.py", "-m", "mpi and (slow or gas)"]),
        (["-n", "4", "-k", "a"], ["-k", "a", "-m", "mpi and not slow"]),
        (["-nauto", "--maxfail=1"], ["--maxfail=1", "-m", "mpi and not slow"]),
    ],
)
def test_markers_of_the_user_are_joined_with_mpi(
    tool, words: list[str], on_ranks: list[str]
) -> None:
    assert tool("run_tests").words_for_ranks(words) == on_ranks


@pytest.mark.parametrize(("codes", "runs"), [((0, 0), 2), ((1,), 1), ((0, 3), 2)])
def test_tests_on_two_ranks_follow_those_on_one(
    tool, monkeypatch: pytest.MonkeyPatch, codes: tuple[int, ...], runs: int
) -> None:
    children = Children(*codes)
    run_tests = tool("run_tests")
    monkeypatch.setattr(run_tests, "run_child", children)
    monkeypatch.chdir(ROOT)
    assert run_tests.main(["tests/unit"]) == codes[-1]
    assert len(children.commands) == runs
    assert children.commands[0][-1] == "tests/unit"
    assert runs == 1 or children.commands[1][:3] == ["mpirun", "-n", "2"]


def test_files_marked_mpi_are_found(tool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = [path.name for path in tool("run_tests").files_marked_mpi()]
    assert "test_study.py" in found and "test_setup.py" not in found


@pytest.mark.parametrize(
    ("codes", "code"), [((0, 0, 0, 0), 0), ((0, 1, 0, 0), 1), ((0, 0, 2, 0), 1)]
)
def test_lint_runs_all_checks(
    tool, monkeypatch: pytest.MonkeyPatch, codes: tuple[int, ...], code: int
) -> None:
    children = Children(*codes)
    lint = tool("lint")
    monkeypatch.setattr(lint, "run_child", children)
    monkeypatch.setattr(lint, "folder_with", lambda packages: Path("/tools") / packages[0])
    monkeypatch.chdir(ROOT)
    assert lint.main() == code
    measured = [" ".join(words[1:]) for words in children.commands]
    assert measured == ["check .", "format --check .", "-m mypy", "tools/words.py"]
    assert children.commands[0][0].startswith("/tools/ruff==")


@pytest.mark.parametrize(
    ("text", "is_private"),
    [
        ("The matrix is made anew.", True),
        ("3 steps, 2 halved", True),
        ("The group is no surface.", True),
        ("There is no group of this name, and the gap is no larger than d.", False),
        ("It changes in place.", False),
        ("`keeps_its_place` and `beside` are names", False),
    ],
)
def test_private_words_are_found(tool, text: str, is_private: bool) -> None:
    words = tool("words")
    assert bool(words.private_words(words.texts_of_page(text))) == is_private


@pytest.mark.parametrize(
    ("message", "is_broken"),
    [
        (
            '(f"the frame of {name!r} falls round the Earth: there is "\n"nothing to hold on to")',
            True,
        ),
        ('("it is on the rim; "\n"name a line between cells")', False),
        (f'("{"a long line " * 7}"\nf"that {{value}} words fill")', False),
    ],
)
def test_messages_that_are_broken_within_a_clause_are_found(
    tool, message: str, is_broken: bool
) -> None:
    assert bool(tool("words").broken_messages(message)) == is_broken


def test_lint_finds_dead_links(tool, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("[here](page.md#top), [there](no.md), [away](https://example.org/no.md)\n")
    assert tool("words").dead_links(page) == ["1: the link leads nowhere: no.md"]


@pytest.mark.parametrize(
    ("options", "code", "told"), [([], 0, True), (["-b", "linkcheck"], 0, False), ([], 2, False)]
)
def test_where_the_site_is_is_told(
    tool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    code: int,
    told: bool,
) -> None:
    build_docs = tool("build_docs")
    monkeypatch.setattr(build_docs, "run_child", Children(code))
    monkeypatch.setattr(build_docs, "folder_with", lambda packages: Path("/tools"))
    monkeypatch.chdir(ROOT)
    assert build_docs.main(options) == code
    assert (str(ROOT / "out" / "docs" / "index.html") in capsys.readouterr().out) == told


def test_packages_are_those_of_the_project(tool) -> None:
    packages = tool("packages")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert packages.extra("dependencies") == project["dependencies"]
    assert packages.extra("lint") == project["optional-dependencies"]["lint"]
    for name in packages.EXTRAS_OF_TESTS:
        assert packages.extra(name)


def test_packages_that_cannot_be_installed_are_named(
    tool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    packages = tool("packages")
    monkeypatch.setattr(packages, "CACHE", tmp_path)
    monkeypatch.setattr(packages, "PIP", ("false",))
    with pytest.raises(SystemExit, match=r"gossamer: sphinx==1 could not be installed from PyPI\."):
        packages.folder_with(["sphinx==1"])
    assert not list(tmp_path.iterdir())


def test_survivors_of_mutants_are_mutants_of_the_present_code(tool) -> None:
    """Each with a reason: one whose line has changed is none any more."""
    nightly = tool("nightly")
    known = json.loads(nightly.SURVIVORS.read_text(encoding="utf-8"))
    for part, (folder, tests) in nightly.PARTS.items():
        assert nightly.files_of(tests)
        keys = set()
        for path in sorted((ROOT / folder).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            start = f"{path.relative_to(ROOT)}: "
            asked = [key for key in known[part] if key.startswith(start)]
            if asked:
                count = sum(1 for _ in nightly._places(ast.parse(source)))
                keys |= {nightly.mutant_of(path, number).key for number in range(count)}
        assert set(known[part]) <= keys
        assert all(reason for reason in known[part].values())


def test_a_mutant_meets_the_tests_that_call_its_function(tool) -> None:
    """Near ones first, then quick ones."""
    nightly = tool("nightly")
    mutant = nightly.Mutant("gas/valves.py", "flow", 1, "a + b", "a + b", "a - b", "")
    called = frozenset({(mutant.path, mutant.function)})
    files = [
        nightly.TestFile("tests/test_slow.py", 9.0, called),
        nightly.TestFile("tests/test_other.py", 1.0, frozenset({(mutant.path, "area")})),
        nightly.TestFile("tests/test_quick.py", 2.0, called),
        nightly.TestFile("tests/test_valve_flows.py", 30.0, called),
    ]
    ordered = [Path(file.path).stem for file in nightly.nearest_first(mutant, files)]
    assert ordered == ["test_valve_flows", "test_quick", "test_slow"]
    # A file whose tests fail without a mutant, or do not end, is noticed.
    failing = [sys.executable, "-c", "import sys; sys.exit(1)"]
    waiting = [sys.executable, "-c", "import time; time.sleep(60)"]
    assert nightly._fails(ROOT, failing)
    assert nightly._fails(ROOT, waiting, longest=0.5)
    assert not nightly._fails(ROOT, [sys.executable, "-c", ""])


def test_a_study_starts_from_moved_nodes(tool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The deflections of shells are measured from the start, and differ from the stored ones."""
    nightly = tool("nightly")
    monkeypatch.setattr(nightly, "LONGEST", None)
    script = nightly.JITTERED.replace("{JITTER}", repr(nightly.JITTER))
    verdict, output = nightly.run_from_moved_start(script, "shells", 1)
    assert verdict == "other figures", output
