"""Normals of a few cells from previews and nominal poses of a capture on the simulated relief."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.quick_look.quick_look import QuickLook, quick_look
from analysis.quick_look.views import CLIPS_FROM, quick_grid, quick_stack
from instrument.config.loading import load_protocol, load_rig
from instrument.session.nominal_views import NominalViews
from instrument.session.preview import Preview
from instrument.session.session import Session
from protocols.capture.engine import capture
from protocols.capture.progress import PoseTaken, Progress
from protocols.planning.session_rig import planned_poses_of
from tests.quick_session import true_normals, write_files


@dataclass(frozen=True)
class Sweep:
    """A capture: what its file says of it, what was told of it, and the truth."""

    views: NominalViews
    previews: dict[int, Preview]
    told: dict[int, Preview]
    truth: NDArray[np.float64]

    def error_deg(self, look: QuickLook) -> float:
        cosine = np.sum(look.normals * self.truth, axis=-1)
        return float(np.rad2deg(np.nanmedian(np.arccos(np.clip(cosine, -1.0, 1.0)))))

    def look(self, changed: Mapping[int, Preview] | None = None) -> QuickLook:
        return quick_look(self.views, self.previews | dict(changed or {}))

    def first(self, n: int) -> QuickLook:
        """Look at n poses spread over the plan."""
        chosen = np.linspace(0, len(self.previews) - 1, n).round().astype(int).tolist()
        return quick_look(self.views, {i_pose: self.previews[i_pose] for i_pose in chosen})


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    folder = tmp_path_factory.mktemp("quick")
    rig_file, protocol_file = write_files(folder)
    rig, seen = load_rig(rig_file), list[Progress]()
    capture(rig, load_protocol(protocol_file), folder / "s.h5", seen.append)
    with Session(folder / "s.h5") as session:
        planned = planned_poses_of(session)
    told = {news.i_pose: news.preview for p in seen if isinstance(news := p.news, PoseTaken)}
    return Sweep(planned.views, dict(planned.previews), told, true_normals(rig))


@pytest.fixture(scope="module")
def whole(sweep: Sweep) -> QuickLook:
    return sweep.look()


def test_normals_are_within_some_degrees_of_the_truth(sweep: Sweep, whole: QuickLook) -> None:
    assert whole.problems == ()
    assert whole.used == tuple(range(20))
    # The flat plate would be 3.6 deg off.
    assert sweep.error_deg(whole) < 3.4
    assert np.isfinite(whole.normals).all()


def test_slopes_come_out_with_their_sign(sweep: Sweep, whole: QuickLook) -> None:
    for axis in (0, 1):
        correlation = np.corrcoef(whole.normals[..., axis].ravel(), sweep.truth[..., axis].ravel())[0, 1]
        assert correlation > 0.3


def test_more_poses_tell_more(sweep: Sweep, whole: QuickLook) -> None:
    few = sweep.first(5)
    assert sweep.error_deg(whole) < sweep.error_deg(few)
    assert np.median(whole.sigma_deg) < 0.7 * np.median(few.sigma_deg)


def test_a_session_says_what_its_watcher_was_told(sweep: Sweep) -> None:
    assert sweep.told.keys() == sweep.previews.keys()
    for i_pose, preview in sweep.previews.items():
        np.testing.assert_array_equal(preview.picture, sweep.told[i_pose].picture)
        assert preview.ceiling == pytest.approx(sweep.told[i_pose].ceiling)


@pytest.mark.parametrize("fault", ["black", "clipped", "moved"])
def test_one_bad_picture_hardly_moves_the_normals(sweep: Sweep, whole: QuickLook, fault: str) -> None:
    preview = sweep.previews[9]
    bad = {
        "black": replace(preview, picture=np.zeros_like(preview.picture)),
        "clipped": replace(preview, picture=np.full_like(preview.picture, preview.ceiling)),
        "moved": replace(preview, picture=np.roll(preview.picture, (12, 15), (0, 1))),
    }[fault]
    look = sweep.look({9: bad})
    assert sweep.error_deg(look) < sweep.error_deg(whole) + 0.5
    assert look.dark == ((9,) if fault == "black" else ())


def test_clipped_cells_are_bounds_and_no_numbers(sweep: Sweep) -> None:
    level = {i: float(np.percentile(p.picture, 90)) for i, p in sweep.previews.items()}
    cut = {i: Preview(np.minimum(p.picture, level[i]), level[i] / CLIPS_FROM) for i, p in sweep.previews.items()}
    untold = {i: replace(p, ceiling=np.inf) for i, p in cut.items()}
    assert np.mean(quick_stack(sweep.views, cut).saturated) > 0.1
    assert sweep.error_deg(quick_look(sweep.views, cut)) < sweep.error_deg(quick_look(sweep.views, untold))


@pytest.mark.parametrize("n", [0, 1, 3])
def test_too_few_poses_say_how_many_are_needed(sweep: Sweep, n: int) -> None:
    look = sweep.first(n)
    assert look.problems == (f"{n} views; at least 4 are needed. Capture more poses.",)
    assert np.isnan(look.normals).all()
    assert (look.coverage is None) == (n == 0)
    assert look.as_dict()["solved_share"] == 0.0


def test_poses_of_one_ring_say_that_another_tilt_is_needed(sweep: Sweep) -> None:
    ring = quick_look(sweep.views, {i: sweep.previews[i] for i in range(1, 7)})
    assert "cone" in ring.problems[0]


def test_all_black_pictures_leave_no_view(sweep: Sweep) -> None:
    black = {i: replace(p, picture=np.zeros_like(p.picture)) for i, p in sweep.previews.items()}
    look = quick_look(sweep.views, black)
    assert look.used == ()
    assert look.dark == tuple(range(20))
    assert look.problems


def test_a_point_of_the_sample_falls_on_the_same_cell_in_every_view(sweep: Sweep) -> None:
    """A white spot that is drawn where each camera sees it, by the pinhole alone, comes back where it was."""
    spot = np.array([11.0, -7.0, 0.0])
    grid = quick_grid(sweep.views.area_mm)
    distance = np.linalg.norm(grid.points() - spot, axis=-1)
    for i_pose in (0, 4, 9, 18):
        stack = quick_stack(sweep.views, {i_pose: _spot(sweep, i_pose, spot)})
        brightest = np.unravel_index(np.argmax(stack.radiance[0, ..., 0]), distance.shape)
        assert distance[brightest] < 1.5 * grid.pitch


def _spot(sweep: Sweep, i_pose: int, spot: NDArray[np.float64]) -> Preview:
    views, shape = sweep.views, sweep.previews[i_pose].picture.shape
    x, y, z = views.rotation[i_pose] @ (spot - views.lens[i_pose])
    block = views.width // shape[1]
    column, row = ((f * views.focal_length_px / z + (n - 1) / 2) for f, n in ((x, views.width), (y, views.height)))
    rows, columns = (block * np.arange(n) + (block - 1) / 2 for n in shape)
    picture = np.exp(-0.5 * ((rows[:, None] - row) ** 2 + (columns - column) ** 2) / block**2)
    return Preview(picture.astype(np.float32), np.inf)
