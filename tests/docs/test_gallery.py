"""The site: its gallery knows every demo, and its sources are links."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gossamer_fx.app.cli.demo import demos_of

ROOT = Path(__file__).parents[2]


@pytest.fixture
def generate(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    monkeypatch.delitem(sys.modules, "generate", raising=False)
    import generate

    return generate


def test_every_demo_is_in_the_gallery_once_with_level_and_time(generate) -> None:
    listed = [demo for subject in generate.subjects() for demo in subject["demos"]]
    names = [demo["name"] for demo in listed]
    assert len(names) == len(set(names)) == len(demos_of(ROOT / "demos"))
    assert {demo["level"] for demo in listed} <= set(generate.LEVELS)
    assert {demo["time"] for demo in listed} <= {"seconds", "minutes", "hours"}


def test_a_demo_that_is_not_listed_is_named(generate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(generate.PROGRAMS, "kite", ROOT / "demos/sails/kite.py")
    with pytest.raises(ValueError, match="sails/kite"):
        generate.subjects()


@pytest.mark.parametrize(
    ("text", "linked"),
    [
        (
            "(doi:10.1007/BF00913408).",
            "([doi:10.1007/BF00913408](<https://doi.org/10.1007/BF00913408>)).",
        ),
        (
            "see doi:10.1016/S0020-7683(98)00123-4, and",
            "see [doi:10.1016/S0020-7683(98)00123-4](<https://doi.org/10.1016/S0020-7683(98)00123-4>), and",
        ),
        ("[doi:10.1002/nme.4668](x)", "[doi:10.1002/nme.4668](x)"),
        ("```text\ndoi:10.1002/nme.4668\n```", "```text\ndoi:10.1002/nme.4668\n```"),
    ],
)
def test_dois_are_links_but_not_in_code(generate, text: str, linked: str) -> None:
    page = [text]
    generate.link_dois(None, "page", page)
    assert page == [linked]


def test_the_code_of_a_notebook_is_that_of_the_demo(generate) -> None:
    for name, _, _ in generate.demos():
        definitions, main = generate.code_of(name)
        compile(definitions, name, "exec")
        compile(main, name, "exec")
        assert "def " in definitions
        assert main
