"""The site: every public name says what it is, programs on pages run, commands and links are ones
that work."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import shlex
import signal
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import gossamer_fx
from gossamer_fx.app.cli.command import _parser
from gossamer_fx.app.cli.demo import demos_of
from gossamer_fx.app.cli.user_files import build_of, check_arguments_of, option
from gossamer_fx.core.checks.ending import SIGNALS
from gossamer_fx.core.checks.lazy_names import public_names

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*(p for p in DOCS.rglob("*.md") if "generated" not in p.parts), ROOT / "README.md"])
LAUNCHER = re.search(r"<<'TEXT'\n(.*?)TEXT", (ROOT / "gossamer").read_text(), re.DOTALL)
COMMANDS = set(re.findall(r"^  (\w+)", LAUNCHER[1], re.MULTILINE)) if LAUNCHER else set()
BENCHMARKS = set(tomllib.loads((ROOT / "demos/benchmarks/problems.toml").read_text()))
NAMES = [str(p.relative_to(ROOT)) for p in PAGES]


@pytest.fixture(scope="module")
def generate() -> Iterator[ModuleType]:
    sys.path.insert(0, str(DOCS))
    yield importlib.import_module("generate")
    sys.path.remove(str(DOCS))


def test_every_public_name_says_what_it_is(generate: ModuleType) -> None:
    assert generate.undocumented() == []


def test_the_reference_has_every_public_name_once(generate: ModuleType) -> None:
    text = "\n".join(generate.reference().values())
    entries = r"\{py:(?:class|function|exception)\} (\w+).*\n:module: ([\w.]+)"
    listed = [f"{module}.{name}" for name, module in re.findall(entries, text)]
    assert sorted(listed) == sorted(f"gossamer_fx.{name}" for name in public_names())


def test_names_in_texts_and_programs_exist() -> None:
    """What follows `gx.`, in pages, docstrings, demos and tests."""
    files = list(PAGES)
    for folder in ("gossamer_fx", "demos", "tests"):
        files += sorted((ROOT / folder).rglob("*.py"))
    found = set()
    for path in files:
        found |= set(re.findall(r"\bgx((?:\.\w+)+)", path.read_text(encoding="utf-8")))
    assert len(found) > 150
    unknown = [dotted for dotted in sorted(found) if not exists(dotted.split(".")[1:])]
    assert unknown == []


def exists(names: list[str]) -> bool:
    """Whether names that follow `gx.` lead to an object: a class or function, or what it has."""
    thing = gossamer_fx
    for name in names:
        if not isinstance(thing, ModuleType):
            return True
        if not hasattr(thing, name):
            return False
        thing = getattr(thing, name)
    return True


def test_docstrings_become_markdown(generate: ModuleType) -> None:
    text = "One * two_three.\n\n    a = b*c\n\nArgs:\n    x: first\n        line.\n    *y: rest."
    made = generate.markdown(text)
    assert "One \\* two\\_three." in made and "```text\na = b*c\n```" in made
    assert "`x`\n:   first\n    line." in made and "`*y`" in made
    example = generate.markdown("First.\n\nExample:\n    >>> 1 + 1\n    2")
    assert "**Example**" in example and "```pycon\n>>> 1 + 1\n2\n```" in example


@pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="the pages are of one rank",
)
@pytest.mark.parametrize("path", PAGES, ids=NAMES)
def test_programs_on_pages_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = path.read_text(encoding="utf-8")
    programs = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    # Every program is marked in the one way that this test finds; files that are shown are run
    # elsewhere.
    others = re.findall(r"^```(?!python\n).*?py.*\n", text, re.MULTILINE | re.IGNORECASE)
    assert [line for line in others if "literalinclude" not in line] == []
    assert not re.findall(
        r"^ *(?:import gossamer_fx|from gossamer_fx)", _not_in(text, programs), re.M
    )
    if path == ROOT / "README.md" or programs:
        assert programs
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for program in programs:
        # The programs of tutorials and how-tos follow each other.
        follows = path.parent.name in ("tutorials", "howto")
        if not follows or not names:
            names = {"__name__": "__main__"}
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(program, str(path), "exec", dont_inherit=True), names)


def _not_in(text: str, programs: list[str]) -> str:
    """A page without its programs."""
    for program in programs:
        text = text.replace(program, "")
    return text


def commands(text: str) -> list[list[str]]:
    """Words of every ./gossamer or gossamer command in a page: in fences, and in code between
    backticks."""
    # A line that ends with a backslash, which is written twice in a docstring, goes on.
    text = re.sub(r"\\+\n\s*", " ", text)
    lines = [
        line.strip()
        for block in re.findall(r"^```(?:sh)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
        for line in block.splitlines()
    ]
    lines += re.findall(r"^    (\./gossamer .*)$", text, re.MULTILINE)
    lines += re.findall(r"`(\./gossamer [^`]*)`", text)
    pieces = [piece.strip() for line in lines for piece in re.sub(r"#.*", "", line).split(";")]
    return [shlex.split(piece)[1:] for piece in pieces if piece.startswith("./gossamer ")]


def _module(scene: Path) -> ModuleType:
    """The module of a scene file of the demos."""
    return importlib.import_module(".".join(scene.relative_to(ROOT).with_suffix("").parts))


GENERATED = "out/"  # folders of runs that a page makes before


# The texts of demos are pages of the gallery.
WITH_COMMANDS = [*PAGES, *sorted(demos_of(ROOT / "demos").values())]


@pytest.mark.parametrize("path", WITH_COMMANDS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_on_pages_are_understood(path: Path) -> None:
    for words in commands(path.read_text(encoding="utf-8")):
        command = words[0]
        rest = words[1:]
        told = " ".join(words)
        assert command in COMMANDS or command == "--help", told
        if any(word.isupper() for word in rest):  # a placeholder
            continue
        if command == "demo" and rest:
            assert rest[0] in demos_of(ROOT / "demos"), told
        elif command == "study":
            assert rest[0] == "all" or (ROOT / "demos" / "studies" / f"{rest[0]}.py").is_file(), (
                told
            )
            assert set(rest[1:]) <= {"--quick", "--fresh"}, told
        elif command == "bench":
            assert rest[0] in {"errors", "all"} | BENCHMARKS, told
        elif command in {"run", "plot", "report", "export"}:
            parsed = _parser().parse_args(words)
            if command == "run" and parsed.scene.parts[0] == "demos":
                scene = ROOT / parsed.scene
                assert scene.is_file(), told
                # Its build takes these arguments, of these kinds.
                check_arguments_of(
                    build_of(scene, _module(scene)),
                    scene,
                    [option(word) for word in parsed.options],
                )
        elif command in {"test", "python", "mpi"}:
            for word in rest:
                if "/" in word and not word.startswith(GENERATED):
                    assert (ROOT / word).exists(), told
            if "-k" in rest:  # a test of this name is in the file
                name = rest[rest.index("-k") + 1]
                (file,) = (ROOT / word for word in rest if word.endswith(".py"))
                assert re.search(rf"def test_\w*{name}", file.read_text(encoding="utf-8")), told


# ---- what is looked for is found -----------------------------------------------------------------


def test_sessions_in_the_reference_are_code(generate: ModuleType) -> None:
    """A session in running text is wider than a phone, and its stars and underscores vanish."""
    pages = generate.reference() | {"meshes": generate.meshes()}
    for name, text in pages.items():
        outside = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        assert ">>>" not in outside, name


def test_every_mesh_generator_has_its_entry(generate: ModuleType) -> None:
    found = [name for name, _ in generate.mesh_generators()]
    assert {"sheet.sheet", "tube.flat_tube", "sphere.sphere", "line.line"} <= set(found)
    text = generate.meshes()
    for name in found:
        module, _, short = name.rpartition(".")
        entry = rf"\{{py:function\}} {short}\(.*\n:module: gossamer_fx\.meshes\.{module}\n\n\w"
        assert re.search(entry, text), name


def test_links_of_source_code_lead_to_the_entries_of_names(generate: ModuleType) -> None:
    """Of one file with `gx.Ledger` and `gx.outputs.Probes`."""
    linked = generate.with_namespaces('"x#gossamer_fx.Ledger" "x#gossamer_fx.Probes.values"')
    assert linked == '"x#gossamer_fx.Ledger" "x#gossamer_fx.outputs.Probes.values"'


@pytest.mark.parametrize(
    "words",
    ["airship", "flatness", "surface accuracy", "viewer", "live", "prestress", "tendon"],
)
def test_guides_use_the_words_of_designers(words: str) -> None:
    """Else the search of the site leads to source code, or nowhere."""
    guides = [*(DOCS / "howto").glob("*.md"), *(DOCS / "tutorials").glob("*.md")]
    guides.append(DOCS / "glossary.md")
    pattern = re.compile(rf"\b{words}\b", re.IGNORECASE)
    assert any(pattern.search(page.read_text(encoding="utf-8")) for page in guides)


# ---- the page of messages ------------------------------------------------------------------------


def test_exit_codes_on_the_page_of_messages_are_those_of_signals_and_errors() -> None:
    page = (DOCS / "messages.md").read_text(encoding="utf-8")
    codes = {int(code) for code in re.findall(r"exit code (\d+)", page)}
    # by SIGUSR2 the launcher hands on Ctrl-C
    assert codes == {1, 2} | {128 + number for number in SIGNALS if number != signal.SIGUSR2}
