"""What the command line writes, and where: results on stdout, notes on stderr, JSON, help, scenes, folders, pipes."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from aerokernels import cli
from aerokernels.display.plain_text import plain, plain_json
from aerokernels.jobs.pages.page import Page
from aerokernels.scene import Scene, SceneError, shipped_scenes


@pytest.fixture
def line(command_line):
    """Call the command line in this process, in an empty folder: status, stdout, stderr."""

    def call(*arguments: str) -> tuple[int, str, str]:
        done = command_line(*arguments)
        return done.returncode, done.stdout, done.stderr

    return call


def test_scenes_are_listed_and_copied(line, tmp_path):
    status, out, err = line("scenes")
    assert status == 0 and err == "" and [row.split("\t")[0] for row in out.splitlines()[1:]] == list(shipped_scenes())
    status, out, err = line("scenes", "copy", "wind-tunnel-mach3")
    assert (status, out) == (0, "") and "wrote wind-tunnel-mach3.toml" in err
    assert Scene.load(tmp_path / "wind-tunnel-mach3.toml") == Scene.load("wind-tunnel-mach3")
    assert "#" in (tmp_path / "wind-tunnel-mach3.toml").read_text()  # comments and all
    status, out, err = line("scenes", "copy", "wind-tunnel-mach3")
    assert status == 2 and err.startswith("error: wind-tunnel-mach3.toml already exists") and err.count("\n") == 1
    assert line("scenes", "copy", "wind-tunnel-mach3", ".", "--force")[0] == 0
    assert "did you mean wind-tunnel-mach3" in line("scenes", "copy", "wind-tunel-mach3")[2]


def test_json_and_quiet_are_taken_anywhere(line):
    for arguments in (("--json", "scenes"), ("scenes", "--json")):
        status, out, _ = line(*arguments)
        assert status == 0 and [row["scene"] for row in json.loads(out)["rows"]] == list(shipped_scenes())
    assert line("scenes", "copy", "wind-tunnel-mach2", "--quiet")[1:] == ("", "")
    assert cli.split_switches(["run", "--json", "--", "--quiet"]) == (["run", "--", "--quiet"], {"--json"})


def test_a_scene_comes_from_standard_input(line, monkeypatch):
    text = Path(cli.__file__).with_name("scenes").joinpath("wind-tunnel-mach3.toml").read_bytes()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text)))
    assert Scene.load("-", {"target.distance": "3 m"}).target.distance == 3.0
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"[flow")))
    status, _, err = line("explain", "-")
    assert status == 2 and err.startswith("error: standard input: not valid TOML")


def test_help_keeps_what_stands_in_brackets(line):
    status, out, _ = line("board", "-h")
    assert status == 0 and "[ps]" in out and "[V]" in out and "[default: until Ctrl-C]" in out
    assert "--install-completion" in line("--help")[1]
    bracketed = 0
    for name, command in typer.main.get_command(cli.app).commands.items():
        texts = [option.help for option in command.params if "[" in (getattr(option, "help", "") or "")]
        if texts:
            shown = "".join(line(name, "--help")[1].split())
            assert all("".join(text.split()) in shown for text in texts), name
        bracketed += len(texts)
    assert bracketed > 13  # so many were eaten as markup


def test_a_pipe_that_closes_does_not_end_the_work(tmp_path):
    """The reader is gone before the first line: what is to be done is done, with status 0 and nothing on stderr."""
    reading, writing = os.pipe()
    os.close(reading)
    code = (
        "from pathlib import Path\nfrom aerokernels.commands import _output\n"
        "for number in range(3): _output.result('a line', number)\nPath('done').touch()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=writing, stderr=subprocess.PIPE, encoding="utf-8"
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "done").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run"], "Missing argument 'SCENE'. See: aerokernels run --help"),
        (["run", "wind-tunnel-mach3", "-o", "o"], "No such option: -o. See: aerokernels run --help"),
        (["scenes", "list"], "No such command 'list'. There are: copy."),
        (["run", "wind-tunnel-mach3", "--out", ""], "--out has an empty value: write a value after it"),
        (["run", "wind-tunnel-mach3", "--out="], "--out has an empty value: write a value after it"),
        (["fields", "flow.pvd", "--time", "nan"], "--time 'nan': give latest, first or a time in seconds"),
        (["strehl", "mach3"], "it is the name of a flow, not of a scene; did you mean sea-level-mach3 or "),
        (["schlieren", "mach3", "--out", "o", "--view", "up"], "--view 'up': give x, y or z, or a direction"),
        (["series", "wind-tunnel-mach3", "--out", "o"], "error: wind-tunnel-mach3: series.source is missing"),
        (["export", ".", "--out", "x.nc"], "store .: a folder or a device, not a file; give the file that `record`"),
        (["export", "text", "--out", "x.nc"], "store text: file is not a database; give "),
        (["sweep", "wind-tunnel-mach3", "--vary", "target.tilt=0:10:5", "--out", "o"],
         "target.tilt = 2.5 rad (143.239 deg) must be below 1.5706 rad"),
        (["explain", "odd.toml"], "unknown key pupil.radius = '3 mm': did you mean beam.radius? [pupil] has shape, "),
    ],
)  # fmt: skip
def test_a_strangers_mistakes_are_answered_with_the_way_out(line, tmp_path, arguments, told):
    (tmp_path / "text").write_text("no store " * 20)
    (tmp_path / "odd.toml").write_bytes(b'\xef\xbb\xbf[flow]\nsource = "mach3"\n[pupil]\nradius = "3 mm"\n')
    status, out, err = line(*arguments)
    assert status == 2 and out == "" and told in err and err.count("\n") == 1, err
    assert len(list(tmp_path.iterdir())) == 2


def test_what_others_wrote_is_shown_without_control_characters(tmp_path: Path):
    """A title that would command a terminal, turn a line round or end a text: in reports, JSON and tables."""
    title = "A\x1b[31mB\x07\u202ec \x9b2J\U000e0001 <i>"
    assert plain(title + "\n\t") == "A\\x1b[31mB\\x07\\u202ec \\x9b2J\\ue0001 <i>\n\t".replace("\\u", "\\x")
    written = plain_json(json.dumps({"title": title}, ensure_ascii=False))
    assert json.loads(written) == {"title": title} and written.isprintable()
    shown = Page("run", title, [(title, title)], tables=[(title, ["a"], [[title]])]).html()
    assert "\x1b" not in shown and "\x9b" not in shown and "\u202e" not in shown and "&lt;i&gt;" in shown
    with pytest.raises(SceneError, match=r"title = .*: a text cannot contain a zero character"):
        Scene.load("wind-tunnel-mach3", {"title": "a\0b"})
