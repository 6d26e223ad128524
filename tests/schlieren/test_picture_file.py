"""Photographs: read with their scale, put below the synthetic picture, and refused where they are none."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aerokernels.benches import Picture, compare_halves, read_picture, write_picture

PITCH = 1e-3
HORIZONTAL = (np.arange(60) - 49) * PITCH
VERTICAL = (np.arange(40) - 19.5) * PITCH


def drawn() -> Picture:
    across, along = np.meshgrid(HORIZONTAL, VERTICAL)
    return Picture(0.5 + 0.4 * np.sin(300.0 * across) * np.cos(200.0 * along) * np.sign(along), HORIZONTAL, VERTICAL)


def test_a_picture_written_and_read_is_the_same(tmp_path: Path):
    """16 bits: half a level of 1/65535. Row 0 of the file is the uppermost; the nose is at z = 0, y = 0."""
    write_picture(tmp_path / "a.png", drawn())
    back = read_picture(tmp_path / "a.png", pixel_size=PITCH, nose=(49.0, 19.5))
    np.testing.assert_allclose(back.intensity, drawn().intensity, atol=0.5 / 65535 + 1e-12)
    np.testing.assert_allclose(back.horizontal, HORIZONTAL, atol=1e-15)
    np.testing.assert_allclose(back.vertical, VERTICAL, atol=1e-15)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "I;16", "F"])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_kinds_of_files(tmp_path: Path, mode: str, suffix: str):
    """Grey, colour, palette, 16 bits and floats give one brightness, to a level of 8 bits."""
    if mode == "F" and suffix == ".png":
        pytest.skip("PNG holds no floats")
    top_first = drawn().intensity[::-1]
    if mode == "F":
        image = Image.fromarray(top_first.astype(np.float32))
    elif mode == "I;16":
        image = Image.fromarray(np.rint(top_first * 65535).astype(np.uint16))
    else:
        image = Image.fromarray(np.rint(top_first * 255).astype(np.uint8)).convert(mode)
    image.save(tmp_path / f"a{suffix}")
    back = read_picture(tmp_path / f"a{suffix}", pixel_size=PITCH, nose=(49.0, 19.5))
    expected = drawn().intensity
    if mode == "F":  # the full white of floats is not known: darkest to brightest
        expected = (expected - expected.min()) / np.ptp(expected)
    np.testing.assert_allclose(back.intensity, expected, atol=1.0 / 255)


def test_a_mirrored_and_a_turned_picture(tmp_path: Path):
    """A flow from the left is mirrored about the nose; a picture turned about the nose is turned back.

    Error of turning twice by linear interpolation: (0.3 PITCH)^2 of second derivatives, 1 % of the brightness.
    """
    plain = drawn()
    write_picture(tmp_path / "left.png", Picture(plain.intensity[:, ::-1], -HORIZONTAL[::-1], VERTICAL))
    back = read_picture(tmp_path / "left.png", pixel_size=PITCH, nose=(59 - 49.0, 19.5), upstream="left")
    np.testing.assert_allclose(back.intensity, plain.intensity, atol=1e-4)
    np.testing.assert_allclose(back.horizontal, HORIZONTAL, atol=1e-12)

    roll = np.radians(5.0)
    across, along = np.meshgrid(HORIZONTAL, VERTICAL)
    # A feature at angle a in the flow's frame is at a + roll in the file.
    own = np.cos(roll) * across + np.sin(roll) * along, -np.sin(roll) * across + np.cos(roll) * along
    smooth = [0.5 + 0.4 * np.sin(150.0 * x) * np.cos(100.0 * y + 0.5) for x, y in (own, (across, along))]
    write_picture(tmp_path / "turned.png", Picture(smooth[0], HORIZONTAL, VERTICAL))
    turned = read_picture(tmp_path / "turned.png", pixel_size=PITCH, nose=(49.0, 19.5), roll=roll)
    inner = (slice(8, -8), slice(8, -8))
    np.testing.assert_allclose(turned.intensity[inner], smooth[1][inner], atol=0.01)


def bad_files(folder: Path) -> dict[str, Path]:
    write_picture(folder / "good.png", drawn())
    whole = (folder / "good.png").read_bytes()
    (folder / "cut.png").write_bytes(whole[: len(whole) // 2])
    (folder / "text.png").write_text("not a readable picture")
    (folder / "empty.png").write_bytes(b"")
    Image.fromarray(np.full((40, 40), 7, np.uint8)).save(folder / "even.png")
    Image.fromarray(np.eye(8, dtype=np.uint8)).save(folder / "small.png")
    pages = [Image.fromarray(np.full((40, 40), k, np.uint8)) for k in (1, 2)]
    pages[0].save(folder / "pages.tif", save_all=True, append_images=pages[1:])
    holes = np.ones((40, 40), np.float32)
    holes[3, 4] = np.nan
    Image.fromarray(holes).save(folder / "holes.tif")
    return {path.stem: path for path in folder.iterdir()} | {"absent": folder / "absent.png", "folder": folder}


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("absent", "no such file"),
        ("folder", "is a folder"),
        ("text", "not a readable picture"),
        ("empty", "not a readable picture"),
        ("cut", "cannot be read"),
        ("even", "a single brightness"),
        ("small", "at least 16"),
        ("pages", "holds 2 pictures"),
        ("holes", "1 pixels are not finite"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, name: str, match: str):
    path = bad_files(tmp_path)[name]
    with pytest.raises(ValueError, match=match) as refused:
        read_picture(path, pixel_size=PITCH, nose=(4.0, 4.0))
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".ppm", ".gif"])
def test_damaged_files_are_read_or_refused_by_name(tmp_path: Path, suffix: str):
    """Bytes changed and ends cut off, 150 times each: a picture, or a ValueError that names the file; nothing else."""
    good, path = tmp_path / f"good{suffix}", tmp_path / f"bad{suffix}"
    Image.fromarray(np.rint(drawn().intensity * 255).astype(np.uint8)).save(good)
    whole, random, refused = good.read_bytes(), np.random.default_rng(2), 0
    for number in range(150):
        damaged = bytearray(whole[: random.integers(1, len(whole)) if number % 3 == 0 else None])
        for _ in range(random.integers(1, 6)):
            damaged[random.integers(min(len(damaged), 200))] = random.integers(256)
        path.write_bytes(damaged)
        try:
            read_picture(path, pixel_size=PITCH, nose=(3.0, 3.0))
        except ValueError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 20


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"pixel_size": 0.0}, "pixel_size"),
        ({"nose": (1.0,)}, "nose"),
        ({"nose": (100.0, 0.0)}, "outside"),
        ({"upstream": "up"}, "upstream"),
        ({"roll": 2.0}, "roll"),
    ],
)
def test_arguments_that_make_no_sense(tmp_path: Path, options: dict, match: str):
    write_picture(tmp_path / "good.png", drawn())
    with pytest.raises(ValueError, match=match):
        read_picture(tmp_path / "good.png", **{"pixel_size": PITCH, "nose": (49.0, 19.5), **options})


def test_halves_of_one_picture_agree():
    """The simulation against itself, darker and with less contrast: r = 1, gain and offset take the change back."""
    plain = drawn()
    found = compare_halves(plain, Picture(0.2 + 0.5 * plain.intensity, HORIZONTAL, VERTICAL))
    assert found.correlation == pytest.approx(1.0, abs=1e-12) and found.covered == 1.0
    assert found.gain == pytest.approx(2.0) and found.offset == pytest.approx(-0.4)
    np.testing.assert_allclose(found.intensity, plain.intensity, atol=1e-12)


def test_halves_on_another_scale():
    """A finer photograph that covers part: above is the simulation, below mid-grey where the photograph ends."""
    plain = drawn()
    fine = np.arange(-0.02, 0.005, 0.25e-3), np.arange(-0.0151, 0.005, 0.25e-3)
    across, along = np.meshgrid(*fine)
    photo = Picture(0.5 + 0.4 * np.sin(300.0 * across) * np.cos(200.0 * along) * np.sign(along), *fine)
    found = compare_halves(plain, photo)
    upper = VERTICAL > 0.0
    np.testing.assert_array_equal(found.intensity[upper], plain.intensity[upper])
    assert found.correlation > 0.999 and 0.1 < found.covered < 0.5
    assert (found.intensity[~upper][:, HORIZONTAL < -0.0205] == 0.5).all()
    data = found.to_xarray()
    assert data.attrs["correlation"] == found.correlation


def test_halves_that_do_not_meet():
    plain = drawn()
    with pytest.raises(ValueError, match="in common"):
        compare_halves(plain, Picture(plain.intensity, HORIZONTAL + 1.0, VERTICAL))
    with pytest.raises(ValueError, match="a single brightness"):
        compare_halves(plain, Picture(np.full_like(plain.intensity, 0.3), HORIZONTAL, VERTICAL))
    with pytest.raises(ValueError, match="even steps"):
        Picture(plain.intensity, np.square(np.arange(60.0)), VERTICAL)
