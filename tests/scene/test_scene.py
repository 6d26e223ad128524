"""Scene files: what they mean, and what is said about those that cannot be used."""

import json
import math
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from aerokernels.jobs.run_files import scene_toml
from aerokernels.scene import STATIC_CALIBRATION, Scene, SceneError, shipped_scenes
from aerokernels.scene.loading import known_keys, shipped_scene_text
from aerokernels.scene.scene import changed_scene, key_dimension

SHIPPED = ("sea-level-mach2", "sea-level-mach3", "sea-level-mach4", *(f"wind-tunnel-mach{m}" for m in (2, 3, 4)))


@pytest.fixture
def write(tmp_path: Path):
    """Write a scene file with a text, return its path."""

    def write(text: str | bytes) -> Path:
        path = tmp_path / "mine.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refusal(place, overrides=None) -> str:
    with pytest.raises(SceneError) as fault:
        Scene.load(place, overrides)
    message = str(fault.value)
    assert "\n" not in message and len(message) < 500
    return message


def test_shipped_scenes():
    assert shipped_scenes() == ("dome-alpha10", *SHIPPED, "wind-tunnel-static")


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_are_the_papers_set_up(name):
    scene = Scene.load(name)
    assert scene.name == name and scene.title
    assert scene.flow.wavelength == 905e-9
    assert (scene.beam.peak_power, scene.target.distance, scene.target.reflectivity) == (75.0, 1.5, 0.3)
    assert (scene.target.width, scene.target.height, scene.target.tilt) == (0.12, 0.09, 0.0)
    assert scene.strehl.ray_count == 1_000_000
    assert scene.detector.volts_per_watt == STATIC_CALIBRATION


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_say_what_is_the_default(name):
    """Their numbers are the documented defaults: a scene with nothing but its flow is the same scene."""
    scene = Scene.load(name)
    bare = Scene(name=scene.name, title=scene.title, flow=scene.flow)
    assert bare == scene


@pytest.mark.parametrize(("mach", "tunnel"), [(2, 0.5287), (3, 0.3319), (4, 0.2108)])
def test_densities(mach, tunnel):
    """Same flow in both families, free stream of the tunnel (isentropic, 4 digits) or of the standard atmosphere."""
    thin = Scene.load(f"wind-tunnel-mach{mach}").density_field()
    dense = Scene.load(f"sea-level-mach{mach}").density_field()
    assert abs(thin.ambient_density - tunnel) < 0.5e-4 and dense.ambient_density == 1.225
    ratio = dense.density / thin.density
    assert abs(ratio / (1.225 / thin.ambient_density) - 1.0).max() < 1e-14
    own = Scene.load(f"wind-tunnel-mach{mach}", {"flow.density": "0.33 kg/m3"}).density_field()
    assert own.ambient_density == 0.33


@pytest.mark.parametrize(("density", "expected"), [("tunnel", 1.225), ("sea-level", 1.225), ("0.4 kg/m3", 0.4)])
def test_static_air(density, expected):
    field = Scene.load("wind-tunnel-static", {"flow.density": density}).density_field()
    assert field.ambient_density == expected and (field.density == expected).all()
    assert field.body is not None and field.conditions is None


def test_scene_is_si_and_cannot_be_changed(write):
    scene = Scene.load(write('[flow]\nsource = "mach2"\n[target]\ntilt = "10 deg"\ndistance = "150 cm"\n'))
    assert scene.name == "mine"
    assert scene.target.tilt == pytest.approx(math.pi / 18, rel=1e-15)
    assert scene.target.distance == 1.5
    with pytest.raises(ValidationError):
        scene.target.distance = 2.0


def test_as_dict_is_json_and_gives_the_scene_back(write):
    scene = Scene.load("sea-level-mach4", {"target.tilt": "10 deg", "strehl.remove": '["piston", "tilt"]'})
    values = json.loads(json.dumps(scene.as_dict(), allow_nan=False))
    assert values["target"]["distance"] == 1.5 and values["flow"]["wavelength"] == 905e-9
    assert values["strehl"]["remove"] == ["piston", "tilt"]
    assert Scene.model_validate(values) == scene


def test_a_scene_in_a_result_is_toml_whatever_its_texts(tmp_path: Path):
    """Species that are no bare keys of TOML, and a title with characters that TOML wants escaped."""
    (tmp_path / "flow.vtu").touch()
    species = {"N2": "Y N2", "NO+": 'Y"NO+"', "basis": "mole"}
    given = {"flow.source": str(tmp_path / "flow.vtu"), "flow.species": species, "title": 'a\x7f\t"b" \\ c'}
    scene = Scene.load("wind-tunnel-static", {**given, "flow.relation": "gladstone-dale"})
    assert Scene.model_validate(tomllib.loads(scene_toml(scene))) == scene


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("target.distance", "1.2 m", 1.2),
        ("target.distance", "1.2", 1.2),
        ("target.distance", '"120 cm"', 1.2),
        ("target.distance", 1.2, 1.2),
        ("beam.ray_count", "1000", 1000),
        ("beam.ray_count", "1e3", 1000),
        ("trace.method", "adaptive", "adaptive"),
        ("trace.tolerance", "1e-4", 1e-4),
        ("strehl.remove", "[]", ()),
        ("detector.bandwidth", "unlimited", None),
        ("detector.bandwidth", "200 MHz", 2e8),
        ("trace.device", "cuda:0", "cuda:0"),
        ("flow.gladstone_dale", "2.24e-4 m3/kg", 2.24e-4),
        ("flow.relation", "ciddor", "ciddor"),
        ("flow.relation", "paper", "paper"),
        ("target.tilt_axis", "[0, 1, 0]", (0.0, 1.0, 0.0)),
        ("receiver.strehl_node_count", "every", "every"),
        ("receiver.strehl_node_count", "11", 11),
        ("detector.noise", "true", True),
        ("detector.bit_count", "unlimited", None),
        ("detector.saturation", "2 V", 2.0),
        ("detector.dark_current", "5 nA", 5e-9),
        ("detector.amplifier_noise", "3 pA/√Hz", 3e-12),
        ("detector.load_resistance", "1.2 kΩ", 1200.0),
        ("detector.responsivity", "550 mA/W", 0.55),
        ("detector.background_power", "0 W", 0.0),
        ("receiver.aperture_z", "-1 cm", -0.01),
    ],
)
def test_overrides(key, text, value):
    scene = Scene.load("wind-tunnel-mach3", {key: text})
    table, leaf = key.split(".")
    assert getattr(getattr(scene, table), leaf) == value


def test_mesh_route_has_its_own_interpolation():
    assert Scene.load("wind-tunnel-mach3").grid.interpolation == "cubic"
    assert Scene.load("wind-tunnel-mach3", {"grid.route": "mesh"}).grid.interpolation == "bilinear"
    paper = {"grid.route": "mesh", "grid.interpolation": "idw", "trace.method": "paper"}
    assert Scene.load("wind-tunnel-mach3", paper).grid.interpolation == "idw"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("[target]\ndistanse = 1", ["unknown key target.distanse = 1", "did you mean target.distance?"]),
        ("[targt]\ndistance = 1", ["unknown key targt", "did you mean target?"]),
        ('[beam]\nwavelength = "905 nm"', ["beam.wavelength", "did you mean flow.wavelength?"]),
        ("[target]\nqqq = 1", ["target.qqq", "distance, tilt"]),
        ('[target]\ndistance = "1.5 kg"', ["target.distance = '1.5 kg'", "a length", "mm"]),
        ('[target]\ndistance = "5 ns"', ["target.distance = '5 ns'", "ns measures a time"]),
        ("[target]\ndistance = nan", ["target.distance = nan", "finite"]),
        ("[target]\ndistance = -inf", ["target.distance = -inf", "finite"]),
        ("[target]\ndistance = -1.5", ["target.distance = -1.5", "at least 1e-09 m"]),
        ("[target]\ndistance = 0", ["target.distance = 0", "at least 1e-09 m"]),
        ("[target]\ndistance = true", ["target.distance = True", "a length"]),
        ("[target]\ndistance = [1.5]", ["target.distance = [1.5]", "a length"]),
        ("[target]\ndistance = 2020-01-01", ["target.distance", "a length"]),
        ('[target]\ntilt = "90 deg"', ["target.tilt = '90 deg'", "below"]),
        ("[target]\nreflectivity = 1.3", ["target.reflectivity = 1.3", "at most 1"]),
        ("[detector]\nfraction = 1", ["detector.fraction = 1", "below 1"]),
        ('[detector]\nresponse = "brick"', ["detector.response = 'brick'", "'bessel', 'butterworth'"]),
        ('[detector]\nnoise = "yes"', ["detector.noise = 'yes'", "valid boolean"]),
        ("[detector]\nnoice = true", ["unknown key detector.noice", "did you mean detector.noise?"]),
        ("[detector]\nbit_count = 30", ["detector.bit_count = 30", "at most 24"]),
        ("[detector]\ngain = 0.5", ["detector.gain = 0.5", "at least 1"]),
        ("[detector]\nadc_low = 5", ["detector.adc_low 5 V", "below detector.adc_high 4.5 V"]),
        ("[detector]\ntrial_count = 1", ["detector.trial_count 1", "at least 2"]),
        ('[detector]\namplifier_noise = "2 pA"', ["detector.amplifier_noise = '2 pA'", "pA/rtHz"]),
        ('[detector]\ndark_current = "-1 nA"', ["detector.dark_current = '-1 nA'", "at least 0"]),
        ('[target]\nreflector = "mirror"', ["target.reflector = 'mirror'", "'lambertian' or 'phong'"]),
        ("[target]\nspecular_share = 1.1", ["target.specular_share = 1.1", "at most 1"]),
        ("[target]\ntilt_axis = [0, 0, 0]", ["target.tilt_axis = [0, 0, 0]", "not all zero"]),
        ('[target]\ntilt_axis = "x"', ["target.tilt_axis = 'x'", "[1, 0, 0]"]),
        ('[receiver]\nreturn_factor = "flux"', ["receiver.return_factor = 'flux'", "'bucket'"]),
        ("[receiver]\nstrehl_node_count = 4", ["receiver.strehl_node_count = 4", "odd", "'every'"]),
        ('[beam]\npulse = "square"', ["beam.pulse = 'square'", "'helios'"]),
        ('[beam]\npulse = "sampled"', ["beam.pulse 'sampled'", "beam.pulse_samples"]),
        ("[beam]\npulse_samples = [0, 1, 2, 1, 0]", ["beam.pulse_samples", "beam.pulse is 'gaussian'"]),
        ('[beam]\npulse = "sampled"\npulse_samples = [3, 2, 1, 0]', ["beam.pulse_samples", "is the first"]),
        ('[beam]\npulse = "sampled"\npulse_samples = [0, -1, 2, 1, 0]', ["beam.pulse_samples", "negative"]),
        ('[detector]\nbandwidth = "wide"', ["detector.bandwidth = 'wide'", "GHz"]),
        ('[detector]\nranging = "centre"', ["detector.ranging = 'centre'", "'centroid' or 'matched-filter'"]),
        ("[beam]\nray_count = 0", ["beam.ray_count = 0", "at least 1"]),
        ("[beam]\nray_count = 10.5", ["beam.ray_count = 10.5", "whole number"]),
        ("[beam]\nray_count = inf", ["beam.ray_count = inf", "whole number"]),
        ('[strehl]\nremove = ["piston", "coma"]', ["strehl.remove = ['piston', 'coma']", "'tilt' or 'focus'"]),
        ('[strehl]\nremove = "piston"', ["strehl.remove = 'piston'", "list"]),
        ('[trace]\nmethod = "fixed"', ["trace.method 'fixed'", "trace.step"]),
        ('[trace]\nbackend = "cuda"', ["trace.backend = 'cuda'", "'warp'"]),
        ('[grid]\nroute = "mesh"\ninterpolation = "cubic"', ["grid.interpolation 'cubic'", "bilinear"]),
        ('[grid]\ninterpolation = "idw"', ["grid.interpolation 'idw'", "monotone"]),
        ("target = 5", ["target = 5", "[target]"]),
    ],
)
def test_faults_in_a_file(write, line, words):
    flow = '[flow]\nsource = "mach2"\n'
    path = write(line + "\n" + flow if line.startswith("target =") else flow + line)
    message = refusal(path)
    for word in [str(path), *words]:
        assert word in message
    assert "(changed)" not in message


NUMBERS = [key for key in known_keys(Scene) if key_dimension(key) or key.endswith(("_count", "order", "steps", "seed"))]


@pytest.mark.parametrize("key", NUMBERS)
def test_every_number_has_bounds(key: str):
    """Numbers out of all proportion ended in an IndexError, an OverflowError or a sentence without the key."""
    enclose = {"pupil.center": "[0, {}, 0]", "pupil.vertices": "[[0, 0], [1, {}], [1, 0]]"}.get(key, "{}")
    for number in ("1e308", "-1e308", "1e30"):
        if enclose == "{}" or float(number) > 0:
            assert f"{key} = " in refusal("wind-tunnel-mach3", {key: enclose.format(number)})
    if key_dimension(key) and enclose == "{}":  # tiny numbers are refused, or as good as 0
        try:
            scene = Scene.load("wind-tunnel-mach3", {key: "5e-324"})
        except SceneError as fault:
            assert key in str(fault)
        else:
            assert Scene.load("wind-tunnel-mach3", {key: "0"}) and scene
    assert len(NUMBERS) > 60


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('source = "mach5"', ["flow.source = 'mach5'", "mach2, mach3, mach4, dome-alpha10, static"]),
        ('source = "mach2"\nwavelength = "905 um"', ["flow.wavelength = '905 um'", "0.1 to 24 um"]),
        ('source = "mach2"\nwavelength = 905', ["flow.wavelength = 905", "give metres"]),
        ('source = "mach2"\ndensity = "thin"', ["flow.density = 'thin'", "'tunnel', 'sea-level'", "kg/m3"]),
        ('source = "mach2"\ndensity = -1', ["flow.density = -1", "at least 1e-12 kg/m3"]),
        ('source = "mach2"\ndensity = nan', ["flow.density = nan", "'0.5 kg/m3'"]),
        ('density = "tunnel"', ["flow.source is missing"]),
        ('source = "mach2"\nrelation = "edlen"', ["flow.relation = 'edlen'", "'ciddor'"]),
        ('source = "mach2"\nrelation = "ciddor"\nwavelength = "1.7 um"', ["flow.relation 'ciddor'", "0.3 to 1.69 um"]),
        (
            'source = "mach2"\nrelation = "ciddor"\ngladstone_dale = "0.22 cm3/g"',
            ["flow.relation 'ciddor'", "take 'gladstone-dale'"],
        ),
    ],
)
def test_faults_in_the_flow(write, line, words):
    message = refusal(write(f"[flow]\n{line}\n"))
    for word in words:
        assert word in message


def test_files_that_are_no_scenes(write, tmp_path):
    assert "did you mean wind-tunnel-mach3?" in refusal("wind-tunel-mach3")
    assert "no such scene file" in refusal(tmp_path / "gone.toml") and "sea-level-mach2" in refusal("gone.toml")
    assert "is a folder" in refusal(tmp_path)
    assert "[flow] with source" in refusal(write(""))
    message = refusal(write('[flow]\nsource = "mach2"\n[target]\ndistance = 1.5 m\n'))
    assert "not valid TOML" in message and "line 4" in message
    assert "not UTF-8" in refusal(write(b'title = "\xff"'))
    assert "not valid TOML" in refusal(write('[flow]\nsource = "mach2"\nsource = "mach3"\n'))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("target.distanse", "1 m", ["target.distanse = '1 m'", "did you mean target.distance?"]),
        ("distance", "1 m", ["unknown key distance", "did you mean target.distance?"]),
        ("target.distance", "1 kg", ["target.distance = '1 kg'"]),
        ("target.distance.x", "1", ["target.distance is a value"]),
        ("target", "1", ["target = 1", "table"]),
        ("", "1", ["'' is not a key"]),
        ("target..tilt", "1", ["'target..tilt' is not a key"]),
        ("trace.method", "fixed", ["trace.step"]),
        ("target.distance", "1\nreflectivity = 2", ["target.distance"]),
    ],
)
def test_faulty_overrides_are_told_from_faults_of_the_file(key, value, words):
    message = refusal("wind-tunnel-mach3", {key: value})
    assert message.startswith("wind-tunnel-mach3.toml (changed): ")
    for word in words:
        assert word in message


def test_more_faults_are_counted(write):
    path = write('[flow]\nsource = "mach2"\n[target]\ndistance = -1\ntilt = "x"\nwidht = 1\n')
    message = refusal(path)
    assert "target.widht" in message and message.endswith("(and 2 more faults)")


def test_a_file_goes_before_a_shipped_scene_of_the_same_name(tmp_path, monkeypatch):
    (tmp_path / "wind-tunnel-mach3").write_text('title = "mine"\n[flow]\nsource = "mach2"\n')
    monkeypatch.chdir(tmp_path)
    assert Scene.load("wind-tunnel-mach3").flow.source == "mach2"


@given(st.sampled_from(known_keys(Scene)), st.text(max_size=15) | st.floats() | st.none() | st.lists(st.integers()))
def test_any_value_is_taken_or_refused_in_one_line(key, value):
    """Nothing but a SceneError that names the key comes out of a bad value."""
    try:
        scene = Scene.load("wind-tunnel-static", {key: value})
    except SceneError as fault:
        assert key in str(fault) and "\n" not in str(fault)
    else:
        json.dumps(scene.as_dict(), allow_nan=False)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_are_written_for_newcomers(name):
    """Each line with a quantity that is a choice or the paper's says so: every table is there, comments explain it."""
    text = shipped_scene_text(name)
    tables = {key for key, value in tomllib.loads(text).items() if isinstance(value, dict)}
    assert {"flow", "beam", "target", "receiver", "detector", "strehl", "trace"} <= tables
    assert text.startswith("# ") and text.count("(paper)") >= 6
    assert max(map(len, text.splitlines())) <= 135


@pytest.mark.parametrize("table", ["beam", "target", "receiver", "atmosphere", "detector"])
def test_every_key_of_the_echo_is_on_its_page(table, root: Path):
    """docs/echo.md names each key in the table of what it describes; the reference has defaults and words."""
    page = (root / "docs" / "echo.md").read_text(encoding="utf-8")
    rows = "".join(line for line in page.splitlines() if line.startswith("| "))
    model = Scene.model_fields[table].annotation
    assert isinstance(model, type) and issubclass(model, BaseModel)
    assert set(re.findall(rf"`({table}\.\w+)`", rows)) == {f"{table}.{name}" for name in model.model_fields}


@pytest.mark.parametrize(
    ("text", "key"),
    [("[beam]\nradius = {a = 1}", "beam.radius"), ("[target]\ntilt_axis = {x = 1}", "target.tilt_axis")],
)
def test_a_table_where_a_value_belongs_is_refused_by_its_key(write, text: str, key: str):
    assert f"mine.toml: {key} = " in refusal(write(f'[flow]\nsource = "mach3"\n{text}\n'))


def test_every_key_says_what_it_is_and_in_what_unit():
    """A description is a sentence; a key that takes numbers has a dimension, or names the unit where it has none."""

    def models(model, prefix=""):
        for name, field in model.model_fields.items():
            if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
                assert (field.annotation.__doc__ or "").startswith(f"[{prefix}{name}]: "), f"{prefix}{name}"
                yield from models(field.annotation, f"{prefix}{name}.")
            else:
                yield prefix + name, field

    ratios = {"target.tilt_axis", "beam.pulse_samples"}  # of which only the proportions count
    found = dict(models(Scene))
    assert set(found) == set(known_keys(Scene)) and {"pupil.azimuth", "flow.file.origin"} <= set(found)
    for key, field in found.items():
        text = field.description or ""
        assert len(text.split()) >= 3 and text.endswith("."), f"{key}: {text!r}"
        if key not in ratios and "float" in str(field.annotation).replace("float32", "").replace("float64", ""):
            assert key_dimension(key) or "[" in text or "unit" in text, f"{key} names no unit: {text!r}"


@pytest.mark.parametrize("changes", [{"flow.file.time": math.inf}, {"flow.file.origin": [0.0, math.nan, 0.0]}])
def test_numbers_of_a_flow_file_are_finite(changes: dict):
    with pytest.raises(SceneError, match=next(iter(changes))):
        Scene.load("wind-tunnel-mach3", changes)


def test_a_changed_scene_does_not_keep_the_name_of_the_shipped_one(write):
    """Values changed by --set, and how a scene is computed, which makes no other scene of it."""
    changes = {"flow.source": "mach4", "target.distance": "2 m"}
    scene = Scene.load("wind-tunnel-mach3", changes)
    assert scene.name == "wind-tunnel-mach3-changed"
    assert scene.title == "Wind tunnel, Mach 3, with flow.source = mach4, target.distance = 2 m"
    again = changed_scene(scene, {"beam.radius": 0.02})
    assert again.name == scene.name and again.title == f"{scene.title}, with beam.radius = 0.02"
    same = Scene.load("wind-tunnel-mach3", {"trace.backend": "reference", "strehl.ray_count": 100})
    assert (same.name, same.title) == ("wind-tunnel-mach3", "Wind tunnel, Mach 3")
    named = Scene.load("wind-tunnel-mach3", {**changes, "name": "mine", "title": "Mine"})
    assert (named.name, named.title) == ("mine", "Mine")
    untitled = Scene.load(write('[flow]\nsource = "mach2"\n'), changes)
    assert untitled.title == "mine, with flow.source = mach4, target.distance = 2 m"
