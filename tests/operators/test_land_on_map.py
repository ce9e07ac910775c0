"""The land of the map: tiles of the server and pixels of the page, compared with points of Natural Earth and with known places."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from browser_world import ANY_TIME_S, SIZE
from matplotlib.path import Path as Outline
from PIL import Image
from server_world import Served

from coastwatch.formats import coastline
from coastwatch.operators import land_tiles
from coastwatch.operators.api.application import WEB
from scaling.page.fleet import served_fleet

pytestmark = pytest.mark.whole

POINTS = Path(__file__).parents[1] / "worlds" / "natural_earth_points.csv"
KNOWN = (
    ("Barents Sea", 75.0, 40.0, False),
    ("north of Norway", 72.0, 25.0, False),
    ("Barents Sea, south", 70.8, 36.0, False),
    ("Finnmark", 69.5, 25.0, True),
    ("Jotunheimen", 61.0, 8.0, True),
    ("Novaya Zemlya", 74.0, 56.5, True),
    ("Svalbard", 78.8, 16.0, True),
    ("English Channel", 50.2, -1.0, False),
    ("Hampshire", 51.1, -1.3, True),
    ("off Rio de Janeiro", -23.4, -43.2, False),
    ("Serra dos Orgaos", -22.4, -43.0, True),
    ("Johor", 2.0, 103.3, True),
    ("South China Sea", 2.0, 105.0, False),
    ("Borneo", 0.5, 114.0, True),
    ("Viti Levu", -17.8, 178.0, True),
    ("Koro Sea", -18.0, 179.9, False),
    ("Chukotka, west", 67.0, 179.0, True),
    ("Chukotka, east", 66.5, -178.5, True),
    ("Wrangel Island", 71.2, -179.6, True),
    ("East Siberian Sea", 72.5, 170.0, False),
    ("Bering Sea", 58.0, 180.0, False),
    ("Weddell Sea", -70.0, -40.0, False),
    ("Antarctica at the end of the map", -85.0, 20.0, True),
    ("Antarctica, 180 degrees", -84.9, 180.0, True),
    ("Arctic at the end of the map", 85.0, 0.0, False),
    ("Arctic, 180 degrees", 84.9, -180.0, False),
    ("Caspian Sea", 42.0, 51.0, False),
    ("Sahara", 23.0, 5.0, True),
    ("Bay of Biscay", 45.5, -4.5, False),
    ("mid-Atlantic", 0.0, -25.0, False),
)
SHADE = 4  # of 255, between a colour of the theme and a pixel of it
VIEWS = (  # latitude, longitude, zoom
    (73.0, 35.0, 3.0),
    (71.0, 25.0, 5.4),
    (70.2, 25.0, 8.0),
    (50.8, -1.3, 9.0),
    (-22.9, -43.1, 12.0),
    (1.2, 104.0, 7.0),
    (-17.0, 179.9, 6.0),
    (67.0, 180.0, 4.0),
    (67.0, -179.0, 7.5),
    (-80.0, 170.0, 3.0),
    (-85.0, 0.0, 5.0),
    (82.0, 20.0, 3.0),
)


def samples() -> list[tuple[float, float, bool, float]]:
    """Latitude, longitude, whether it is land, and km to the nearest shore."""
    with POINTS.open(encoding="utf-8") as file:
        rows = [
            (float(r["latitude_deg"]), float(r["longitude_deg"]), r["is_land"] == "1", float(r["clear_km"]))
            for r in csv.DictReader(file)
        ]
    assert len(rows) >= 700
    return rows


def pixel_km(zoom: float, latitude: float) -> float:
    return float(40_075.0 * np.cos(np.radians(latitude)) / (512.0 * 2.0**zoom))


def mercator(latitude: float, longitude: float) -> tuple[float, float]:
    """Shares of the map from the antimeridian and the north."""
    return (longitude + 180.0) / 360.0, 0.5 - float(np.arcsinh(np.tan(np.radians(latitude)))) / (2.0 * np.pi)


def fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and value of each field of a message of protocol buffers."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(data):
        key = varint()
        value = varint()
        if key & 7 == 0:
            yield key >> 3, value
            continue
        assert key & 7 == 2
        yield key >> 3, data[at : at + value]
        at += value


def numbers(data: bytes) -> list[int]:
    out, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            out.append(value)
            value = shift = 0
    return out


@cache
def rings(zoom: int, x: int, y: int) -> list[tuple[np.ndarray, bool]]:
    """Closed rings of a tile in shares of its side, and whether each is an outer one, by the sign of its area."""
    data = land_tiles.tile(zoom, x, y)
    if not data:
        return []
    ((number, layer),) = fields(data)
    assert number == 3
    content = list(fields(layer))  # type: ignore[arg-type]
    assert dict(content)[1] == b"land"
    assert dict(content)[15] == 2
    extent: Any = dict(content)[5]
    found = []
    for _, feature in (field for field in content if field[0] == 2):
        assert dict(fields(feature))[3] == 3  # type: ignore[arg-type]
        given = iter(numbers(dict(fields(feature))[4]))  # type: ignore[arg-type]
        cursor, ring = np.zeros(2, np.int64), []
        for command in given:
            if command == 15:
                closed = np.array([*ring, ring[0]])
                (x0, y0), (x1, y1) = closed[:-1].T, closed[1:].T
                area = float((x0 * y1 - x1 * y0).sum())
                assert area != 0.0
                found.append((closed / extent, area > 0.0))
                continue
            ring = [] if command & 7 == 1 else ring
            for _ in range(command >> 3):
                cursor = cursor + [(n >> 1) ^ -(n & 1) for n in (next(given), next(given))]
                ring.append(cursor)
    assert not found or found[0][1]  # a hole follows its outer ring
    return found


def is_land(zoom: int, latitude: float, longitude: float) -> bool:
    """What the tile of a zoom has at a point."""
    x, y = (share * 2.0**zoom for share in mercator(latitude, (longitude + 180.0) % 360.0 - 180.0))
    at = np.array([x % 1.0, y % 1.0])
    near = (row for row in rings(zoom, int(x), int(y)) if (row[0].min(0) <= at).all() and (at <= row[0].max(0)).all())
    over = [outer for ring, outer in near if Outline(ring).contains_point(at)]
    assert over.count(True) - over.count(False) in (0, 1)
    return over.count(True) > over.count(False)


@pytest.mark.parametrize("zoom", range(land_tiles.MOST_ZOOM + 1))
def test_tiles_have_land_and_sea_where_natural_earth_has_them(zoom: int) -> None:
    """Two pixels away from each shore, at every third point. Beyond the last zoom the map enlarges its tiles, four times at zoom 12."""
    shown = zoom if zoom < land_tiles.MOST_ZOOM else 12
    clear = [row for row in samples()[zoom % 3 :: 3] if row[3] > 2.0 * pixel_km(shown, row[0])]
    assert {row[2] for row in clear} == {False, True} or zoom < 3
    wrong = [(lat, lon, "land" if land else "sea") for lat, lon, land, _ in clear if is_land(zoom, lat, lon) is not land]
    assert wrong == []


@pytest.mark.parametrize(("place", "latitude", "longitude", "land"), KNOWN)
def test_known_places_are_land_or_sea_at_each_zoom(place: str, latitude: float, longitude: float, land: bool) -> None:
    assert [is_land(zoom, latitude, longitude) for zoom in range(2, 9)] == [land] * 7


@pytest.mark.parametrize("zoom", [1, 4, 7])
def test_no_shore_is_drawn_along_an_edge_of_a_tile(zoom: int) -> None:
    """Along the antimeridian, the end of the map and other edges there is land on both sides, or sea."""
    last = 2**zoom - 1
    places = [
        mercator(lat, lon)
        for lat, lon in ((67.5, -180.0), (67.5, 179.999), (-80.0, 0.0), (-85.0, 180.0), (-85.0, 10.0), (60.0, 90.0))
    ]
    for x, y in {(min(int(px * 2**zoom), last), min(int(py * 2**zoom), last)) for px, py in places}:
        found = rings(zoom, x, y)
        assert found
        for ring, _ in found:
            begin, end = ring[:-1], ring[1:]
            for axis in (0, 1):
                along = (np.abs(begin[:, axis] - end[:, axis]) < 1e-9) & (np.abs(begin - end).max(1) > 0.02)
                inside = (begin[:, axis] > -0.01) & (begin[:, axis] < 1.01)
                assert not (along & inside).any(), (x, y, begin[along & inside])


@pytest.mark.slow
def test_outlines_are_valid_and_go_round_the_globe_without_a_step() -> None:
    for level in ("fine", "coarse"):
        land = coastline.polygons(level)
        assert shapely.is_valid(land).all()
        first, last = shapely.total_bounds(land)[[0, 2]]
        assert first < 0.0
        assert last > coastline.TURN_STEPS
        one, other = shapely.STRtree(land).query(land, predicate="overlaps")
        assert level == "coarse" or not len(one), (one, other)


def test_the_server_sends_tiles_to_anybody_and_refuses_those_that_are_not_there(served: Served) -> None:
    answer = served.get("/land/5/17/7")
    assert answer.content == land_tiles.tile(5, 17, 7) != b""
    assert answer.headers["content-type"] == "application/vnd.mapbox-vector-tile"
    assert "max-age" in answer.headers["cache-control"]
    assert served.get("/land/8/20/100").content == b""  # the Pacific
    for wrong in ("9/0/0", "3/8/0", "3/0/8", "3/-1/0", "-1/0/0"):
        assert served.get(f"/land/{wrong}").status_code == 404, wrong


@pytest.mark.parametrize(("zoom", "most"), [(0, 80_000), (3, 20_000), (5, 20_000), (8, 5_000)])
def test_tiles_have_few_bytes(zoom: int, most: int) -> None:
    """Fjords of Norway, where shores are longest; the land of the world in one piece had 1 MB."""
    x, y = (int(share * 2.0**zoom) for share in mercator(69.0, 17.0))
    assert len(land_tiles.tile(zoom, x, y)) < most


@pytest.fixture(scope="module")
def page(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The page without vessels in the views."""
    with served_fleet(1, 1, tmp_path_factory.mktemp("fleet"), WEB) as address:
        opened = browser.new_page(viewport=SIZE)
        opened.goto(f"{address}/?lat=0&lon=0&zoom=2")
        until(opened, "window.coastwatch?.points?.uploaded && coastwatch.map.isStyleLoaded()")
        yield opened


def until(page: Any, script: str) -> None:
    """Ask until it is so: the page's policy forbids Playwright's own waiting for a text."""
    end = time.monotonic() + ANY_TIME_S
    while not page.evaluate(script):
        assert time.monotonic() < end, script
        time.sleep(0.05)


def show(page: Any, latitude: float, longitude: float, zoom: float) -> np.ndarray:
    """The pixels of the chart once its land is drawn, (H, W, 3)."""
    page.evaluate(f"(coastwatch.map.jumpTo({{center: [{longitude}, {latitude}], zoom: {zoom}}}), 0)")
    page.evaluate("new Promise(done => coastwatch.map.once('idle', () => done(0)).triggerRepaint())")
    until(page, "coastwatch.map.areTilesLoaded()")
    page.evaluate("new Promise(done => coastwatch.map.once('render', () => done(0)).triggerRepaint())")
    taken = page.screenshot(clip=page.locator("#chart").bounding_box())
    return np.asarray(Image.open(io.BytesIO(taken)).convert("RGB"), np.float64)


@cache
def fine_land() -> tuple[shapely.STRtree, shapely.STRtree]:
    """The land of the finest level, and its shores."""
    land = coastline.polygons("fine")
    return shapely.STRtree(land), shapely.STRtree(shapely.boundary(land))


@pytest.mark.parametrize(("latitude", "longitude", "zoom"), VIEWS)
def test_the_page_draws_land_and_sea_where_natural_earth_has_them(
    page: Any, latitude: float, longitude: float, zoom: float
) -> None:
    pixels = show(page, latitude, longitude, zoom)
    across, down = (v.ravel() for v in np.meshgrid(np.arange(20, 880, 20), np.arange(70, pixels.shape[0] - 60, 20)))
    asked = (
        f"{np.stack([across, down], 1).tolist()}.map(p => {{ const q = coastwatch.map.unproject(p); return [q.lat, q.lng]; }})"
    )
    position = np.array(page.evaluate(asked))
    turned = np.stack([position[:, 0], (position[:, 1] + 180.0) % 360.0 - 180.0], 1)
    points = shapely.points(((turned - coastline.OFFSET_DEG) / coastline.SCALE_DEG)[:, ::-1])
    land, lines = fine_land()
    expected = np.zeros(len(points), bool)
    expected[land.query(points, predicate="within")[0]] = True
    pixel_steps = 360.0 / (512.0 * 2.0**zoom) / coastline.SCALE_DEG[1]
    beside = np.zeros(len(points), bool)
    beside[lines.query(points, predicate="dwithin", distance=6.0 * pixel_steps)[0]] = True
    assert (~beside).sum() > 200
    colours = page.evaluate("(({sea, land}) => [sea, land])(coastwatch.theme())")
    end = time.monotonic() + ANY_TIME_S
    while wrong := wrong_pixels(pixels[down, across], expected, np.flatnonzero(~beside), colours):
        assert time.monotonic() < end, [(*position[k].round(3).tolist(), colour) for k, colour in wrong]
        pixels = show(page, latitude, longitude, zoom)  # a coarser tile is shown until the browser has drawn the finer one


def wrong_pixels(
    pixels: np.ndarray, land: np.ndarray, asked: np.ndarray, colours: list[list[float]]
) -> list[tuple[int, list[float]]]:
    """Rows of `pixels` of those asked, (M,), that have not the colour of their surface, with the one they have.

    Args: land: (N,), whether each is land; colours: of sea and of land.
    """
    wanted = np.array(colours)[land.astype(int)]
    return [(int(k), pixels[k].tolist()) for k in asked if np.abs(pixels[k] - wanted[k]).max() > SHADE]


def test_the_page_asks_again_for_land_that_did_not_come(page: Any) -> None:
    page.route("**/land/**", lambda route: route.abort())
    with page.expect_event("requestfailed", lambda request: "/land/8/" in request.url):
        page.evaluate("(coastwatch.map.jumpTo({center: [5, 23], zoom: 8.5}), 0)")
    until(page, "coastwatch.map.areTilesLoaded()")  # or refused
    with page.expect_response(lambda answer: "/land/8/" in answer.url and answer.ok, timeout=1e3 * ANY_TIME_S):
        page.unroute("**/land/**")
    until(page, "coastwatch.map.areTilesLoaded()")
