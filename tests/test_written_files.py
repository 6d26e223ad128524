"""Files that are written at one go: a full disk leaves an earlier file as it was, and nothing that is half-written."""

import os
from pathlib import Path

import numpy as np
import pytest

from aerokernels import Camera, Disc, Wavefront, flow
from aerokernels.benches import Picture, write_picture
from aerokernels.files.writing import OutputError, replacing, write_grey
from aerokernels.imaging.bos import BackgroundPictures
from aerokernels.imaging.shift import BackgroundDisplacement
from aerokernels.jobs.pages.air import save_flow_figure

NOISE = np.random.default_rng(1).random((60, 70))


def wavefront() -> Wavefront:
    return Wavefront(1e-7 * NOISE[:40, :40], np.ones((40, 40)), 1e-3, 1e-6)


def background(path: Path) -> None:
    """Two pictures and a NetCDF file of 3 x 4 pixels, which is the greatest of them."""
    camera, pair = Camera(Disc(1e-4), 0.05, 1e-5, (3, 4), distance=0.2), np.zeros((3, 4, 2))
    traced = BackgroundDisplacement(pair, pair, np.ones((3, 4)), camera, 1e-6)
    BackgroundPictures(NOISE[:3, :4], NOISE[:3, :4], traced).write(path.parent)


def fits(path: Path) -> None:
    pytest.importorskip("astropy")
    wavefront().to_fits(path)


WRITERS = {
    "grey.tiff": lambda path: write_grey(path, NOISE),
    "grey.png": lambda path: write_grey(path, NOISE),
    "picture.png": lambda path: write_picture(path, Picture(NOISE, np.arange(70.0), np.arange(60.0))),
    "grid.dat": lambda path: wavefront().to_zemax(path),
    "opd.fits": fits,
    "reference.tiff": background,
    "flow.png": lambda path: save_flow_figure(flow.wedge(2.5, 0.17, length=0.1, height=0.08), path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_an_earlier_file_as_it_was(name: str, tmp_path: Path, full_disk):
    """What to do is said, once for the file that was asked for."""
    place = tmp_path / name
    WRITERS[name](place)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert max(map(len, made.values())) > 2000
    full_disk(2000)
    with pytest.raises(OutputError, match=f"^{place}: .*: make room, or choose another place$"):
        WRITERS[name](place)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == made


def test_files_that_belong_together_appear_together(tmp_path: Path):
    """A link is followed and stays; what is no regular file is written as it is."""
    first, second, link = tmp_path / "a", tmp_path / "b", tmp_path / "link"
    first.write_text("old")
    link.symlink_to(first)
    with pytest.raises(RuntimeError), replacing(link, second) as drafts:
        for draft in drafts:
            draft.write_text("new")
        raise RuntimeError
    assert first.read_text() == "old" and not second.exists()
    with replacing(link, second) as drafts:
        for draft in drafts:
            draft.write_text("new")
        assert first.read_text() == "old"
    assert link.is_symlink() and first.read_text() == second.read_text() == "new"
    with replacing(Path(os.devnull)) as (draft,):
        assert draft == Path(os.devnull)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "link"]
