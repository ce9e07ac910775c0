"""The plot: it is a PNG of the right size, everything in the scene is in it, and the antimeridian changes nothing but labels."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.path import Path as Outline

from coastwatch.batches import Flag, Floats
from coastwatch.errors import InputError
from coastwatch.formats import coastline
from coastwatch.geodesy import offset_deg, wrap_deg
from coastwatch.operators import plot, scene

pytestmark = pytest.mark.contract

SEED = 20
NATURAL_EARTH_POINTS = Path(__file__).parents[1] / "worlds" / "natural_earth_points.csv"
ROUND_EARTH = 0.02  # a degree of latitude and one of longitude differ by under 1 % at the equator
PIXEL_SHARE = 0.004  # of pixels that may differ between two places: tick labels and their grid lines are drawn at other minutes


def a_scene(centre_deg: tuple[float, float], vessels: int = 30) -> scene.Scene:
    rng = np.random.default_rng([SEED, 1, 0])
    centre = np.array(centre_deg)
    position = offset_deg(centre, rng.uniform(-9000.0, 9000.0, (vessels, 2)))
    velocity = rng.normal(0.0, 4.0, (vessels, 2))
    kinds = np.array([scene.AIS_ONLY, scene.RADAR_ONLY, scene.FUSED])
    ellipse = np.tile([20.0, 5.0, 90.0], (vessels, 1))
    ellipse[:3] = np.nan
    site: Floats = offset_deg(centre, np.array([0.0, -4000.0]))
    bearing = min(vessels, 4)
    return scene.Scene(
        title="Trial",
        subtitle="run 1",
        centre_deg=centre_deg,
        width_nm=10.0,
        height_nm=8.0,
        coverages=(
            scene.Coverage("north", scene.RADAR, centre, 6000.0),
            scene.Coverage("listener", scene.STATION, centre, 9000.0),
            scene.Coverage("sonar", scene.BEARING, site, 5000.0, (270.0, 90.0)),
        ),
        position_deg=position,
        velocity_m_s=velocity,
        ellipse=ellipse,
        kind=kinds[np.arange(vessels) % 3],
        flags=np.where(np.arange(vessels) == 1, int(Flag.DARK), 0),
        bearing_from_deg=np.tile(site, (bearing, 1)),
        bearing_to_deg=position[:bearing],
        trails_deg=tuple(np.stack([p, q]) for p, q in zip(offset_deg(position, -120.0 * velocity), position, strict=True)),
        trail_s=120.0,
    )


def pixels(made: scene.Scene) -> Floats:
    canvas = FigureCanvasAgg(plot.draw(made))
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), float)


def labels(made: scene.Scene) -> list[str]:
    legend = plot.draw(made).axes[0].get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_a_png_is_written(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    plot.write(a_scene((-22.9, -43.1)), str(path))
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert path.stat().st_size > 20_000
    assert list(tmp_path.iterdir()) == [path]


def test_the_legend_counts_what_is_drawn() -> None:
    said = labels(replace(a_scene((-22.9, -43.1)), width_nm=12.0, height_nm=12.0))
    for wanted in ("AIS only (10)", "radar only (10)", "fused (10)", "associated bearing (4)", "leader, 3 min ahead"):
        assert wanted in said
    assert any(text.startswith("dark") and text.endswith("(1)") for text in said)
    assert any("2 sigma, drawn" in text for text in said)
    assert "north: radar, 3.24 NM" in said


def test_the_long_axis_of_an_ellipse_points_where_it_should() -> None:
    made = a_scene((0.0, 20.0))
    outlines = plot.draw(made).axes[0].collections
    (ellipses,) = [c for c in outlines if isinstance(c, PolyCollection)]
    spans = np.array([np.ptp(path.vertices, axis=0) for path in ellipses.get_paths()])
    assert len(spans) == 27  # three have none
    np.testing.assert_allclose(spans[:, 0] / spans[:, 1], 4.0, rtol=ROUND_EARTH)


def test_an_empty_picture_is_drawn() -> None:
    assert "fused (0)" in labels(a_scene((-22.9, -43.1), vessels=0))


def test_the_antimeridian_moves_nothing() -> None:
    inside, across = (pixels(a_scene((-17.0, lon))) for lon in (170.0, 180.0))
    assert inside.shape == across.shape
    assert (np.abs(inside - across).max(-1) > 64.0).mean() < PIXEL_SHARE
    across = pixels(a_scene((-17.0, -180.0)))
    assert (np.abs(inside - across).max(-1) > 64.0).mean() < PIXEL_SHARE


@pytest.mark.parametrize(
    ("value", "ends", "step", "text"),
    [
        (-22.5, "NS", 5, "22°30'S"),
        (180.05, "EW", 1, "179°57'W"),
        (-43.0, "EW", 10, "43°00'W"),
        (0.0, "NS", 1, "0°00'N"),
        (10.0083333333, "EW", 0.5, "10°00.5'E"),
        (9.9999999999, "EW", 1, "10°00'E"),
    ],
)
def test_degrees_are_written_with_minutes(value: float, ends: str, step: float, text: str) -> None:
    assert plot._degrees(value, ends, step) == text


def test_a_coastline_is_read_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    bay = Path(__file__).parents[2] / "scenarios" / "guanabara" / "coastline.geojson"
    shores, note = coastline.read(bay)
    assert note.startswith("approximate, not for navigation")
    assert sum(len(s.position_deg) for s in shores) >= 60
    assert all(s.closed and (s.position_deg[0] == s.position_deg[-1]).all() for s in shores)
    every = np.vstack([s.position_deg for s in shores])
    assert (np.abs(every - [-22.88, -43.15]) < 0.4).all()
    wrong = tmp_path / "wrong.geojson"
    for text in ("{", '{"type": "Feature"}', "[]", '{"type": "LineString", "coordinates": [["a", 1]]}'):
        wrong.write_text(text)
        with pytest.raises(InputError, match=r"wrong\.geojson"):
            coastline.read(wrong)


def test_vessels_outside_the_frame_are_counted_apart() -> None:
    made = a_scene((-22.9, -43.1))
    north = np.array(made.position_deg)
    north[[0, 3], 0] += 1.0  # two of AIS alone
    said = labels(replace(made, position_deg=north, height_nm=20.0))
    assert "AIS only (8, 2 outside the frame)" in said
    assert "fused (10)" in said


def test_the_scale_bar_is_below_the_frame_and_hides_nothing() -> None:
    axes = plot.draw(a_scene((-22.9, -43.1))).axes[0]
    (bar,) = [text for text in axes.texts if text.get_text() == "2 NM"]
    _, y = bar.get_transform().transform(bar.get_position())
    assert y < axes.bbox.y0
    assert not axes.patches or all(patch.get_zorder() < 7 for patch in axes.patches)


def test_selected_vessels_and_the_longest_ones_are_named_without_formulas() -> None:
    made = replace(a_scene((-22.9, -43.1)), names=((2, "$EVER$ GIVEN"), (4, "TUG")), selected=(4,))
    axes = plot.draw(made).axes[0]
    named = {text.get_text(): text for text in axes.texts}
    assert not any(named[name].get_parse_math() for name in ("$EVER$ GIVEN", "TUG"))


@pytest.mark.parametrize(
    ("place", "latitude", "longitude", "is_land"),
    [
        ("Paris", 48.85, 2.35, True),
        ("the Channel", 50.2, -1.0, False),
        ("the Caspian Sea", 42.0, 51.0, False),
        ("east of the antimeridian, Chukotka", 66.5, 181.5, True),
        ("the same from the other side", 66.5, -178.5, True),
        ("west of Fiji", -17.0, 176.0, False),
        ("near the South Pole", -88.0, 170.0, True),
    ],
)
def test_land_of_natural_earth(place: str, latitude: float, longitude: float, is_land: bool) -> None:
    shores = coastline.natural_earth(latitude - 1.0, longitude - 1.0, latitude + 1.0, longitude + 1.0)
    assert covers(shores, latitude, longitude) is is_land
    for shore in shores:  # cut at the edges
        assert (np.abs(shore.position_deg - [latitude, longitude]) <= 1.0 + 1e-9).all()


def covers(shores: tuple[coastline.Shore, ...], latitude: float, longitude: float) -> bool:
    """Whether a point is on land; it may be on one outline, and not in a lake of it."""
    at = (latitude, longitude)
    over = [shore for shore in shores if shore.closed and Outline(shore.position_deg).contains_point(at)]
    dry = [shore for shore in over if not any(Outline(lake).contains_point(at) for lake in shore.lakes_deg)]
    assert len(dry) <= 1
    return bool(dry)


FRAMES = (  # south, west, north, east
    (66.0, 5.0, 79.0, 65.0),
    (-20.0, 176.0, -15.0, 183.0),
    (-20.0, -184.0, -15.0, -177.0),
    (60.0, 165.0, 73.0, 195.0),
    (-89.0, -180.0, -62.0, 180.0),
    (-89.0, -198.0, 89.0, 198.0),
    (-60.0, 10.0, 85.0, 370.0),
)


@pytest.mark.parametrize("frame", FRAMES)
def test_the_land_of_a_frame_is_that_of_natural_earth(frame: tuple[float, float, float, float]) -> None:
    south, west, north, east = frame
    shores = coastline.natural_earth(south, west, north, east)
    seen = {False: 0, True: 0}
    wrong = []
    low, high = (np.array([end(shore.position_deg, axis=0) for shore in shores]) for end in (np.min, np.max))
    for row in csv.DictReader(NATURAL_EARTH_POINTS.read_text(encoding="utf-8").splitlines()):
        latitude, is_land = float(row["latitude_deg"]), row["is_land"] == "1"
        longitude = west + (float(row["longitude_deg"]) - west) % 360.0
        if south < latitude < north and longitude < east:
            seen[is_land] += 1
            near = np.flatnonzero(((low <= [latitude, longitude]) & (high >= [latitude, longitude])).all(1))
            if covers(tuple(shores[k] for k in near), latitude, longitude) is not is_land:
                wrong.append((latitude, longitude, is_land))
    assert min(seen.values()) >= 30
    assert wrong == []


@pytest.mark.parametrize(
    ("bbox", "land", "sea"),
    [
        ((66.0, 5.0, 79.0, 65.0), [(69.5, 25.0), (74.0, 56.5)], [(75.0, 40.0), (72.0, 25.0)]),
        ((60.0, 165.0, 73.0, -165.0), [(66.5, -178.5), (67.0, 179.0), (71.2, -179.6)], [(72.5, 170.0), (61.0, 180.0)]),
        ((36.0, 46.0, 48.0, 56.0), [(40.3, 47.4), (40.3, 55.3)], [(42.3, 51.3)]),  # the Caspian Sea
        ((-80.0, -179.0, 80.0, 179.0), [(66.5, -178.5), (23.3, 6.3), (-77.3, 103.3)], [(-3.3, -26.3), (75.3, 43.3)]),
    ],
)
def test_land_and_sea_are_drawn_in_their_colours(
    bbox: tuple[float, float, float, float], land: list[tuple[float, float]], sea: list[tuple[float, float]]
) -> None:
    centre_deg, width_nm, height_nm = scene._frame({}, bbox)
    bare = replace(a_scene(centre_deg, 0), centre_deg=centre_deg, width_nm=width_nm, height_nm=height_nm, coverages=())
    made = replace(bare, land=scene._land("none of ours", None, bare)[0])
    canvas = FigureCanvasAgg(plot.draw(made))
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba(), float)[::-1]
    axes = canvas.figure.axes[0]
    for points, colour in ((land, plot.LAND), (sea, plot.WATER)):
        for latitude, longitude in points:
            x, y = axes.transData.transform((centre_deg[1] + wrap_deg(longitude - centre_deg[1]), latitude))
            got = image[round(y) + np.arange(-1, 2)[:, None], round(x) + np.arange(-1, 2), :3]
            assert np.abs(got - 255.0 * np.array(to_rgb(colour))).max(axis=-1).min() < 4.0, (latitude, longitude)


def test_a_coastline_of_a_file_is_drawn_on_the_side_of_the_antimeridian_that_the_frame_is_on(tmp_path: Path) -> None:
    ring = [[179.9, -17.0], [-179.9, -17.0], [-179.9, -16.9], [179.9, -16.9], [179.9, -17.0]]
    path = tmp_path / "island.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}), "utf-8")
    for centre, west in ((179.95, 179.9), (-179.95, -180.1)):
        (shore,), _ = scene._land("none of ours", str(path), a_scene((-17.0, centre)))
        assert shore.position_deg[:, 1] == pytest.approx([west, west + 0.2, west + 0.2, west, west])


def test_cells_of_the_learnt_cover_are_coloured_by_their_step():
    """Each cell has the colour of its probability, and the legend counts them."""
    bare = a_scene((10.0, 20.0))
    corners = offset_deg(np.array([10.0, 20.0]), np.array([[0.0, 0.0], [900.0, 0.0], [900.0, 900.0], [0.0, 900.0]]))
    cells = np.stack([corners, corners + 0.01, corners - 0.01])
    made = plot.draw(replace(bare, cover=scene.CoverCells(cells, np.array([0.1, 0.8, 0.9]), False)))
    drawn = [c for c in made.axes[0].collections if isinstance(c, PolyCollection) and len(c.get_paths()) == 3]
    (colours,) = [found for c in drawn if len({*map(tuple, found := c.get_facecolor().tolist())}) == 2]
    assert colours[0] != colours[1] == colours[2]
    legend = made.axes[0].get_legend()
    texts = [text.get_text() for text in legend.get_texts()] if legend else []
    assert "radars detect under 25 % of AIS vessels (1 cells)" in texts
    assert "75 % or more (2 cells)" in texts
