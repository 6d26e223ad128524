"""What the command line writes, and where: results on stdout, notes on stderr, JSON, help, scenes, folders, pipes."""

import errno
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from aerokernels import cli
from aerokernels.commands import _output
from aerokernels.display.plain_text import plain, plain_json
from aerokernels.jobs.page import page, table
from aerokernels.jobs.store import check_output_folder, staged_folder, write_summary
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


def test_control_characters_do_not_reach_the_terminal():
    assert _output.plain("a\x1b[31mred\x07\x9b2J\ttab µ\n") == "a\\x1b[31mred\\x07\\x9b2J\ttab µ\n"


def test_a_folder_of_other_files_is_refused_and_an_earlier_result_replaced_whole(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("mine")
    with pytest.raises(ValueError, match=r"holds thesis\.tex, and no result of an earlier run"):
        check_output_folder(out)
    check_output_folder(out, own=("thesis.tex",))
    (out / "summary.json").write_text('{"mine": 1}')
    with pytest.raises(ValueError, match=r"holds summary\.json and more"):
        check_output_folder(out)
    for path in out.iterdir():
        path.unlink()
    for names in (("a.png", "b.png"), ("b.png",)):
        check_output_folder(out)
        with staged_folder(out) as folder:
            for name in names:
                (folder / name).write_text(str(names))
            write_summary(folder / "summary.json", {"version": "1"})
        (out / "notes.txt").write_text("kept")
    assert sorted(path.name for path in out.iterdir()) == ["b.png", "notes.txt", "summary.json"]
    assert json.loads((out / "summary.json").read_text())["files"] == ["b.png", "summary.json"]


def test_the_command_line_has_pythons_names_and_defaults(line):
    """One name and one default for the same thing: knife edge, pixels, fringes, screen; the short names stay."""
    from inspect import signature

    from aerokernels import schlieren
    from aerokernels.commands.schlieren import schlieren as command
    from aerokernels.jobs.pictures import PictureOptions
    from aerokernels.schlieren import line_of_sight

    asked = {name: parameter.default for name, parameter in signature(command).parameters.items()}
    assert asked["knife_edge"] == signature(schlieren).parameters["knife_edge"].default == PictureOptions().knife_edge
    assert asked["pixels"] == signature(line_of_sight).parameters["pixel_count"].default == PictureOptions().pixel_count
    text = line("schlieren", "--help")[1]
    assert all(
        f"{long}, {short} " in text for long, short in (("--pixel-count", "--pixels"), ("--distance", "--screen"))
    )
    assert "--fringe-spacing, --fringes " in text


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
         "target.tilt = '2.5 rad' must be below 1.5706 rad"),
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
    shown = page(title, title, [table(title, ("a",), [(title,)])])
    assert "\x1b" not in shown and "\x9b" not in shown and "\u202e" not in shown and "&lt;i&gt;" in shown
    with pytest.raises(SceneError, match=r"title = .*: a text cannot contain a zero character"):
        Scene.load("wind-tunnel-mach3", {"title": "a\0b"})


def test_a_missing_file_is_bad_input_only_where_the_command_line_names_it():
    """Its path or a folder of it: "out" does not name "out2/x", although its text is how that begins."""
    from aerokernels.cli import exit_status

    missing = FileNotFoundError(errno.ENOENT, "no such file", "out2/x")
    for line, status in (
        (["--out", "out2"], 2),
        (["--out=out2/x"], 2),
        (["--out", "out2/x/y"], 2),
        (["--out", "out"], 1),
    ):
        assert exit_status(missing, line) == status, line
