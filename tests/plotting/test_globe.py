"""The globe and the film on it: where things stand in the picture, and what is in front."""

import base64
import gc
import io
import re
import warnings
import weakref
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import reference
from builders import make_plan
from drawn import filled
from exports import flown_plan, truth
from matplotlib import pyplot
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from PIL import Image
from reference import assert_each

import jaxplan as jp
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan
from jaxplan.plotting import film as film_module
from jaxplan.plotting.projections import FlatMap, GlobeView, circle
from jaxplan.plotting.style import device_style
from jaxplan.plotting.zones import draw_zone

RNG = np.random.default_rng(11)
DIRECTIONS = RNG.standard_normal((200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
VIEW = (40.0, 25.0)


@pytest.fixture(scope="module")
def plan() -> Plan:
    flown = flown_plan()
    zones = {
        "keep_out": (
            KeepOut(name="near", direction=DIRECTIONS[0], half_angle=0.4),
            KeepOut(name="wide", direction=DIRECTIONS[1], half_angle=2.3),
        ),
        "keep_in": (KeepIn(name="in", direction=DIRECTIONS[2], half_angle=0.5, devices=("terminal-0",)),),
    }
    return replace(flown, scenario=replace(flown.scenario, **zones))


def test_a_view_looks_from_where_it_is_said_with_north_up():
    azimuth, elevation = np.deg2rad(VIEW)
    view = GlobeView.from_angles(azimuth, elevation)
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(view.axes), 1)
    np.testing.assert_allclose(view.axes[2], reference.direction(azimuth, elevation))
    north = view.project(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(north, [0, np.cos(elevation)], atol=1e-15)


def test_a_chosen_view_has_a_bundle_of_directions_in_front():
    for direction in DIRECTIONS[np.abs(DIRECTIONS[:, 2]) < 0.9]:
        view = GlobeView.facing(circle(direction, 0.3))
        assert_each(view.depth(circle(direction, 0.3)), ">", 0)


def test_the_two_sides_of_a_line_meet_and_are_the_whole_of_it():
    view = GlobeView.from_angles(0.3, 0.2)
    line = circle(DIRECTIONS[3], 1.2)
    (near, _), (far, alpha) = view.parts(line)
    assert alpha < 0.5
    np.testing.assert_allclose(np.where(np.isnan(near), far, near), view.project(line))
    drawn = ~np.isnan(np.stack([near, far])[:, :, 0])
    np.testing.assert_array_equal(drawn[0], view.depth(line) >= 0)
    meetings = np.abs(np.diff(drawn[0].astype(int))).sum()
    assert np.sum(drawn.all(axis=0)) == meetings == 2


@pytest.mark.parametrize("half_angle", [0.05, 0.4, np.pi / 2, 2.3, 3.1])
def test_a_zone_is_filled_where_it_is_on_either_side(half_angle):
    view, axis = GlobeView.from_angles(1.0, -0.4), DIRECTIONS[4]
    np.testing.assert_allclose(circle(axis, half_angle) @ axis, np.cos(half_angle), atol=1e-14)
    for side, sheet in zip((1, -1), view.sheets(axis, half_angle), strict=True):
        column, row = RNG.integers(0, len(sheet.across), (2, 300))
        x, y = sheet.across[column], sheet.upward[row]
        on = x**2 + y**2 < 0.98
        depth = np.sqrt(1 - x[on] ** 2 - y[on] ** 2)
        points = np.stack([x[on], y[on], side * depth], axis=1) @ view.axes
        np.testing.assert_allclose(sheet.directions[row[on], column[on]], points, atol=1e-12)
        found = view.directions(np.stack([x[on], y[on]], axis=1), side * view.axes[2])
        np.testing.assert_allclose(found, points, atol=1e-12)
    np.testing.assert_array_equal(view.directions(np.array([[0.8, 0.8]]), view.axes[2]), np.nan)
    axes = Figure().subplots()
    zone = KeepOut(name="zone", direction=axis, half_angle=half_angle)
    areas = [area for area in draw_zone(axes, view, zone) if hasattr(area, "get_paths")]
    places = view.project(DIRECTIONS)
    covered = np.any([filled(area, places) for area in areas], axis=0)
    mirrored = DIRECTIONS - 2 * view.depth(DIRECTIONS)[:, None] * view.axes[2]
    depth = half_angle - np.arccos(np.stack([DIRECTIONS, mirrored]) @ axis)
    sure = np.all(np.abs(depth) > 0.03, axis=0) & (np.abs(view.depth(DIRECTIONS)) > 0.15)
    assert np.count_nonzero(sure) > 100
    np.testing.assert_array_equal(covered[sure], np.any(depth > 0, axis=0)[sure])


@pytest.mark.parametrize("half_angle_deg", [0.02, 0.3])
@pytest.mark.parametrize("axis", [[0.6, 0.0, 0.8], [-1.0, 0.0, 0.0], [-0.4, -0.3, -np.sqrt(0.75)], [0, 0, 1]])
def test_the_smallest_zones_are_filled_too(axis, half_angle_deg):
    axis, half_angle = np.array(axis, dtype=float), np.deg2rad(half_angle_deg)
    zone = KeepOut(name="zone", direction=axis, half_angle=half_angle)
    for projection in (FlatMap(), GlobeView.from_angles(1.0, 0.4)):
        areas = draw_zone(Figure().subplots(), projection, zone)[:-1]
        around = projection.project(np.vstack([0.2 * circle(axis, half_angle) + 0.8 * axis, axis]))
        areas = [area for area in areas if hasattr(area, "get_paths")]
        assert np.all(np.any([filled(area, around) for area in areas], axis=0)), projection


def test_every_way_on_the_globe_is_that_of_the_boresight(plan):
    axes = jp.plot.globe(plan, view=VIEW)
    view = GlobeView.from_angles(*np.deg2rad(VIEW))
    times = np.linspace(0, plan.trajectory.duration, 1024)
    expected = view.project(truth(plan, times).boresights)
    for device in range(3):
        own = [
            line
            for line in axes.lines
            if line.get_color() == device_style(device)["color"] and len(line.get_xdata()) == 1024
        ]
        near, far = (np.stack(line.get_data(), axis=1).astype(float) for line in own)
        np.testing.assert_allclose(np.where(np.isnan(near), far, near), expected[:, device], atol=1e-9)
        assert own[0].get_alpha() is None
        assert own[1].get_alpha() < 0.5
    words = [text.get_text() for text in axes.texts]
    assert {"near", "wide", "in"} <= set(words)
    assert any("azimuth 40, elevation 25 deg" in word for word in words)


def test_the_film_shows_the_beams_where_the_boresights_are(plan):
    film = jp.plot.animate(plan, view=VIEW, frames=3)
    axes = film._fig.axes[0]
    view = GlobeView.from_angles(*np.deg2rad(VIEW))
    times = np.linspace(0, plan.trajectory.duration, 1024)
    html = film.to_jshtml()
    assert html.count("data:image/png;base64") == 3
    for number in (700, 1023):
        film._func(number)
        tips = view.project(truth(plan, times[number : number + 1]).boresights[0])
        for device, tip in enumerate(tips):
            beams = [
                line
                for line in axes.lines
                if line.get_color() == device_style(device)["color"] and len(line.get_xdata()) == 2
            ]
            assert len(beams) == 1
            np.testing.assert_allclose(np.stack(beams[0].get_data(), axis=1)[1], tip, atol=1e-9)
        clock = next(text.get_text() for text in axes.texts if " of 30.0 s" in text.get_text())
        assert clock.startswith(f"{times[number]:.1f} of 30.0 s\nsmallest margin ")


def test_a_film_can_be_saved_and_needs_a_motion(plan, tmp_path):
    before = dict(mpl.rcParams)
    bare = replace(plan, scenario=replace(plan.scenario, keep_out=(), keep_in=()))
    jp.plot.animate(bare, frames=2).save(tmp_path / "slew.gif", writer="pillow", dpi=30)
    assert (tmp_path / "slew.gif").read_bytes().startswith(b"GIF8")

    def full(number: int, _: int) -> None:
        if number == 1:
            raise OSError("no space left")

    with pytest.raises(OSError, match="no space left"):
        jp.plot.animate(bare, frames=2).save(
            tmp_path / "other.gif", writer="pillow", dpi=30, progress_callback=full
        )
    assert [file.name for file in tmp_path.iterdir()] == ["slew.gif"]
    with pytest.raises(ValueError, match="no trajectory to draw"):
        jp.plot.animate(replace(plan, trajectory=None))
    assert dict(mpl.rcParams) == before
    assert not pyplot.get_fignums()


@pytest.fixture
def no_ffmpeg(monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("new/slew.mp4", RuntimeError, r"as \.mp4 only where ffmpeg is installed.*or save as \.gif"),
        ("new/slew.mpq", ValueError, r"ends in '\.mpq'.*must end in one of \.gif, .*\.mp4"),
        ("new/slew", ValueError, r"has no ending.*must end in one of \.gif"),
        ("folder.gif", IsADirectoryError, "is a folder"),
        ("file.txt/slew.gif", NotADirectoryError, r"file\.txt is a file, not a folder"),
    ],
)
def test_a_film_that_cannot_be_saved_says_what_to_do(plan, tmp_path, no_ffmpeg, name, error, words):
    (tmp_path / "folder.gif").mkdir()
    (tmp_path / "file.txt").touch()
    with pytest.raises(error, match=words):
        jp.plot.animate(plan, frames=2).save(tmp_path / name)
    assert {file.name for file in tmp_path.iterdir()} == {"folder.gif", "file.txt"}, "no folder is left over"


def test_a_film_makes_its_folder_and_needs_no_ffmpeg_for_a_gif(plan, tmp_path, no_ffmpeg):
    jp.plot.animate(plan, frames=2).save(tmp_path / "new" / "slew.GIF", dpi=30)
    assert (tmp_path / "new" / "slew.GIF").read_bytes().startswith(b"GIF8")


def test_a_film_shows_itself_as_a_small_player(plan, monkeypatch):
    monkeypatch.setattr(film_module, "_MAX_PLAYER_FRAMES", 2)
    film = jp.plot.animate(plan, frames=5)
    pages = film._repr_html_(), jp.plot.animate(plan, frames=2)._repr_html_()
    for page in pages:
        pictures = re.findall(r'"data:image/png;base64,([^"]+)"', page)
        assert len(pictures) == 2
        for picture in pictures:
            assert Image.open(io.BytesIO(base64.b64decode(picture))).mode == "P", "a palette of few colours"
            assert len(picture) < 1e5
        assert "<script" in page


def test_a_film_that_nobody_saw_is_dropped_without_a_warning(plan):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        film = weakref.ref(jp.plot.animate(plan, frames=2))
        gc.collect()
        assert film() is None
    assert caught == []


def test_a_film_lasts_as_long_as_its_figure(plan):
    figure = Figure()
    film = weakref.ref(jp.plot.animate(plan, ax=figure, frames=2))
    gc.collect()
    assert film() is not None


def test_a_notebook_shows_the_player_and_not_the_figure_too(plan):
    pytest.importorskip("matplotlib_inline")
    backend = mpl.get_backend()
    mpl.use("module://matplotlib_inline.backend_inline")
    try:
        jp.plot.animate(plan, frames=2)
        assert pyplot.get_fignums() == []
    finally:
        mpl.use(backend)


def test_the_clock_of_a_film_stands_above_the_globe(plan):
    film = jp.plot.animate(plan, frames=2)
    film.figure.draw_without_rendering()
    (axes,) = film.figure.axes
    clock = next(text for text in axes.texts if "smallest margin" in text.get_text())
    top = axes.transData.transform((0, 1))[1]
    assert clock.get_window_extent().y0 > top
    assert {"start", "goal"} <= {text.get_text() for text in axes.get_legend().get_texts()}
    with pytest.raises(ValueError, match="frames = 0: must be 1 or more"):
        jp.plot.animate(plan, frames=0)


def test_the_globe_of_a_failed_plan_shows_what_there_is(plan):
    failed = replace(plan, status=jp.Status.NO_PATH, trajectory=None, path=None, goal=None)
    axes = jp.plot.globe(failed)
    assert "NO_PATH" in axes.get_title(loc="left")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"start", "goal", "keep-out zone"} <= set(labels)
    assert jp.plot.globe(plan, legend=False).get_legend() is None


def test_a_platform_without_devices_turns_too():
    plan = flown_plan(terminals=0)
    craft = replace(plan.scenario.spacecraft, instruments=())
    bare = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    film = jp.plot.animate(bare, frames=2)
    assert film.to_jshtml().count("data:image/png;base64") == 2
    assert jp.plot.globe(bare).get_title(loc="left").startswith("an odd slew")


def test_the_legend_of_many_devices_is_within_the_picture():
    axes = jp.plot.globe(make_plan(12, 14))
    axes.figure.draw_without_rendering()
    assert axes.get_legend()._ncols == 2
    assert axes.get_legend().get_window_extent().x1 <= axes.figure.bbox.x1
