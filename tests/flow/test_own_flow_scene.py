"""A scene with a flow of one's own: paths, [flow.file], the run, and what `aerokernels fields` shows of the file."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "reading"))
import writers

from aerokernels import flow
from aerokernels.cli import exit_status, one_line
from aerokernels.commands.listing import fields
from aerokernels.scene import Scene, SceneError


@pytest.fixture
def folder(tmp_path):
    r, z = np.linspace(0.0, 30.0, 31), np.linspace(-20.0, 10.0, 31)
    bump = np.exp(-((r[:, None] / 9.0) ** 2) - ((z - 2.0) / 3.0) ** 2)
    np.savez(tmp_path / "flow.npz", r=r, z=z, rho=0.4 * (1.0 + 0.3 * bump))
    (tmp_path / "scene.toml").write_text(
        '[flow]\nsource = "flow.npz"\nfile = {length_unit = "mm"}\n[strehl]\nray_count = 1000\n'
    )
    return tmp_path


def test_source_is_relative_to_the_scene_file(folder, monkeypatch):
    """Loaded from another folder; the field is the one that `flow.read` makes; the scene loads again from its text."""
    from aerokernels.jobs.run_files import scene_toml

    monkeypatch.chdir("/")
    scene = Scene.load(folder / "scene.toml")
    assert scene.flow.source == str(folder / "flow.npz")
    field, same = scene.density_field(), flow.read(folder / "flow.npz", length_unit="mm")
    assert np.array_equal(field.density, same.density) and field.ambient_density == same.ambient_density
    (folder / "again.toml").write_text(scene_toml(scene))
    assert Scene.load(folder / "again.toml") == scene


def test_density_scales_the_flow_of_a_file(folder):
    scene = Scene.load(folder / "scene.toml", {"flow.density": "0.8 kg/m3"})
    own = Scene.load(folder / "scene.toml").density_field()
    assert scene.density_field().density == pytest.approx(own.density * 0.8 / own.ambient_density, rel=1e-14)


def test_a_scene_of_a_file_runs(folder):
    """Expected: the Strehl ratio of the scene is that of the same field handed over by hand."""
    from aerokernels import simulate

    scene = Scene.load(folder / "scene.toml", {"target.distance": "1.5 m"})
    by_path = simulate(scene)
    by_hand = simulate(scene, field=flow.read(folder / "flow.npz", length_unit="mm"))
    assert 0.0 < by_path.strehl.value < 1.0
    assert by_path.strehl.value == by_hand.strehl.value
    assert "flow.npz" in by_path.prepared.provenance


def test_explain_names_the_grid_of_a_flow_on_a_grid(folder):
    """A volume on a uniform grid is traced on it: it has no mesh that the index could be interpolated on."""
    from aerokernels.jobs.explain import explanation

    across, z = np.linspace(-20.0, 20.0, 21), np.linspace(-20.0, 10.0, 16)
    bump = np.exp(-((across[:, None, None] ** 2 + across[:, None] ** 2) / 81.0) - ((z - 2.0) / 3.0) ** 2)
    np.savez(folder / "flow.npz", x=across, y=across, z=z, rho=0.4 * (1.0 + 0.003 * bump))
    rows = dict(explanation(Scene.load(folder / "scene.toml")))
    assert rows["grid"] == "21 x 21 x 16 nodes, those of the flow, cubic"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('source = "nowhere.vtu"', r"flow.source = 'nowhere.vtu': no such file; choose one of mach2, "),
        ('source = "flow.npz"\nfile = {optical = "w"}', "flow.file.optical"),
        ('source = "flow.npz"\nfile = {pressure = "p"}', "go together"),
        ('source = "flow.npz"\nfile = {tiem = 1}', "unknown key flow.file.tiem"),
        ('source = "flow.npz"\nfile = {length_unit = "kg"}', "flow.file.length_unit"),
        ('source = "flow.npz"\nfile = {time = "soon"}', "'latest', 'first'"),
    ],
)
def test_refused_scenes(folder, text, message):
    (folder / "bad.toml").write_text(f"[flow]\n{text}\n")
    with pytest.raises(SceneError, match=message):
        Scene.load(folder / "bad.toml")


def test_fields_shows_a_file_and_draws_it(folder, capsys):
    fields(folder / "flow.npz", picture=folder / "flow.png", length_unit="mm")
    shown = capsys.readouterr().out
    assert "31 x 31" in shown and "array rho" in shown and "axisymmetric" in shown and "0 to 30 mm" in shown
    assert (folder / "flow.png").read_bytes().startswith(b"\x89PNG")
    case = writers.foam_wedge(folder / "case")
    fields(case)
    shown = capsys.readouterr().out
    assert "times\t1: 0.5" in shown and "body (wall)" in shown


def test_fields_of_a_damaged_file_is_bad_input(folder):
    (folder / "flow.npz").write_bytes(b"PK\3\4")
    with pytest.raises(flow.ReadError) as caught:
        fields(folder / "flow.npz")
    assert exit_status(caught.value) == 2 and "flow.npz" in one_line(caught.value)
