"""What makes the documents: the reference from the program, the checks of the built site, docstring examples."""

import doctest
import importlib
import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module", autouse=True)
def generators():
    """The modules that make pages from the program."""
    folder = str(ROOT / "docs" / "_ext")
    sys.path.insert(0, folder)
    yield
    sys.path.remove(folder)


def test_the_reference_holds_every_public_name_once():
    import api_pages

    import aerokernels

    shown = api_pages.shown_names()
    names = [name for page in shown.values() for name in page]
    assert len(names) == len(set(names))
    things = {id(api_pages.resolve(name)) for name in names}
    modules = {"flow", "zernike", "echo", "schlieren", "strehl", "wavefront"}
    for name in set(aerokernels.__all__) - modules:
        assert id(getattr(aerokernels, name)) in things, f"aerokernels.{name} is on no page of the reference"


def test_made_pages_hold_what_they_are_made_from():
    """Every key of every table with its text, every command with every option, every record with its files."""
    import command_pages
    import scene_pages
    import validation_pages

    scene = scene_pages.page()
    for table, model in scene_pages.tables().items():
        for name, field in model.model_fields.items():
            dotted = f"{table}.{name}".lstrip(".")
            if dotted in scene_pages.tables():
                assert f"## [{dotted}]" in scene
                continue
            (row,) = [line for line in scene.splitlines() if line.startswith(f"| `{dotted}` |")]
            assert field.description and scene_pages._text(field.description).replace("|", "\\|") in row
    page = command_pages.page()
    sections = dict(zip(*[iter(re.split(r"^## (.+)\n", page, flags=re.MULTILINE)[1:])] * 2, strict=True))
    for name, command in command_pages.commands().items():
        assert all(
            f"`{option}`" in sections[name] for param in command.params for option in param.opts if option[0] == "-"
        )
    for name, record in validation_pages.records().items():
        for file in (*record["pages"], *record["results"], *record["sources"]):
            assert (ROOT / file).exists(), f"{name}: {file}"
        script = record["command"].split()[0]
        assert script == "aerokernels" or (ROOT / script).exists(), f"{name}: {script}"
        assert f"| {name} |" in validation_pages.page()


def modules_with_examples() -> list[str]:
    paths = [path for path in (ROOT / "aerokernels").rglob("*.py") if ">>>" in path.read_text(encoding="utf-8")]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in sorted(paths)]


@pytest.mark.parametrize("name", modules_with_examples())
def test_docstring_examples_run(name: str):
    module = importlib.import_module(name)
    failed, tried = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert tried and not failed
