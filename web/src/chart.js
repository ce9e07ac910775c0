// The map: land of Natural Earth in tiles of the server, the scenario's own coastline, zones, and the layer of vessels.

import { Map as LandMap, setWorkerUrl } from 'maplibre-gl';
import { getJson } from './api.js';
import { css, symbolSize, THEMES } from './symbols.js';

const LAND_MOST_ZOOM = 8; // of tiles; the map enlarges them beyond it
const AGAIN_MS = 5000;
const SOFTWARE = /SwiftShader|llvmpipe|softpipe|Microsoft Basic Render/i;
const NOTHING = { type: 'FeatureCollection', features: [] };

/**
 * Makes the map. North is up and nothing tilts: positions on the screen are then linear in mercator.
 * @param {HTMLElement} container
 * @param {{lat: number, lon: number, zoom: number}} view
 * @returns {import('maplibre-gl').Map}
 */
export function makeMap(container, { lat, lon, zoom }) {
  setWorkerUrl(new URL('./maplibre-gl-worker.mjs', document.baseURI).href);
  const map = new LandMap({
    container, center: [lon, lat], zoom, minZoom: 1, maxZoom: 18, maxPitch: 0, fadeDuration: 0,
    attributionControl: false, dragRotate: false, pitchWithRotate: false, touchPitch: false,
    canvasContextAttributes: { antialias: false, preserveDrawingBuffer: false },
    style: {
      version: 8,
      sources: { land: tiles(), coastline: geojson(), zones: geojson(), draft: geojson() },
      layers: [
        { id: 'sea', type: 'background' },
        { id: 'land', type: 'fill', source: 'land', 'source-layer': 'land', paint: { 'fill-antialias': false } },
        { id: 'shore', type: 'line', source: 'land', 'source-layer': 'land' },
        { id: 'own-sea', type: 'fill', source: 'coastline', minzoom: 7, filter: ['==', ['get', 'kind'], 'extent'] },
        { id: 'own-land', type: 'fill', source: 'coastline', minzoom: 7, filter: ['!=', ['get', 'kind'], 'extent'] },
        { id: 'own-shore', type: 'line', source: 'coastline', minzoom: 7, filter: ['!=', ['get', 'kind'], 'extent'] },
        { id: 'zones', type: 'line', source: 'zones', paint: { 'line-dasharray': [4, 2], 'line-width': 1.5 } },
        { id: 'draft', type: 'line', source: 'draft', paint: { 'line-width': 2 } },
        { id: 'draft-points', type: 'circle', source: 'draft', filter: ['==', ['geometry-type'], 'Point'], paint: { 'circle-radius': 4 } },
      ],
    },
  });
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  const canvas = map.getCanvas();
  canvas.setAttribute('aria-label', 'Chart of vessels. Arrow keys pan, plus and minus zoom. The vessel list has the same vessels as text.');
  return map;
}

const tiles = () => ({
  type: 'vector', tiles: [`${new URL('./land/', document.baseURI).href}{z}/{x}/{y}`], maxzoom: LAND_MOST_ZOOM,
});
const geojson = () => ({ type: 'geojson', data: NOTHING, tolerance: 0.375, buffer: 16, maxzoom: 10 });

/** Whether the page draws without a GPU. */
export function drawsInSoftware(map) {
  const gl = map.getCanvas().getContext('webgl2');
  const names = gl?.getExtension('WEBGL_debug_renderer_info');
  return SOFTWARE.test(names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : '');
}

/** Asks again for tiles of land that did not come: the server was away or had too many requests. */
export function keepLand(map) {
  let missing = [];
  map.on('error', ({ sourceId, tile, error }) => {
    if (sourceId !== 'land' || !tile) {
      console.error(error); // as where nobody listens
      return;
    }
    if (!missing.length) setTimeout(askAgain, AGAIN_MS);
    missing.push(tile.tileID.canonical);
  });
  const askAgain = () => {
    const tiles = missing;
    missing = [];
    map.refreshTiles('land', tiles); // of all tiles it waits for ever for those that failed
  };
}

/** Shows the coastline of the scenario over the land of the bundle. @returns {Promise<boolean>} false: it has none */
export async function loadCoastline(map) {
  try {
    const coastline = await getJson('coastline');
    map.getSource('coastline').setData({ ...coastline, features: [extent(coastline), ...coastline.features] });
    return true;
  } catch {
    return false;
  }
}

/** The rectangle of a coastline, drawn as sea below its land, so that the coarse shore does not show through: its bbox, if it has one. */
function extent(coastline) {
  let [west, south, east, north] = coastline.bbox ?? [180, 90, -180, -90];
  const widen = (part) => {
    if (typeof part[0] !== 'number') return part.forEach(widen);
    [west, south, east, north] = [Math.min(west, part[0]), Math.min(south, part[1]), Math.max(east, part[0]), Math.max(north, part[1])];
  };
  const areas = coastline.features.filter(({ geometry }) => geometry?.type.endsWith('Polygon'));
  if (!coastline.bbox) areas.forEach(({ geometry }) => widen(geometry.coordinates));
  const ring = areas.length ? [[west, south], [east, south], [east, north], [west, north], [west, south]] : [];
  return { type: 'Feature', properties: { kind: 'extent' }, geometry: { type: 'Polygon', coordinates: ring.length ? [ring] : [] } };
}

/** Zones of the watch. Args: zones: a FeatureCollection, or null: none are drawn. */
export const setZones = (map, zones) => map.getSource('zones').setData(zones ?? NOTHING);

/** The zone that is being drawn. */
export const setDraft = (map, draft) => map.getSource('draft').setData(draft);

/** Colours of a theme for land, shore and zones. */
export function paintChart(map, name) {
  const theme = THEMES[name];
  const paint = {
    sea: ['background-color', 'sea'], land: ['fill-color', 'land'], shore: ['line-color', 'shore'],
    'own-sea': ['fill-color', 'sea'], 'own-land': ['fill-color', 'land'], 'own-shore': ['line-color', 'shore'],
    zones: ['line-color', 'flagged'], draft: ['line-color', 'selected'], 'draft-points': ['circle-color', 'selected'],
  };
  for (const [layer, [property, colour]] of Object.entries(paint)) map.setPaintProperty(layer, property, css(theme[colour]));
}

/** Milliseconds between drawings of moving vessels: as long as 30 knots take for half a pixel, 1 s in software. */
export function drawEveryMs(map, software) {
  const metresAPixel = (40.03e6 * Math.cos((map.getCenter().lat * Math.PI) / 180)) / (512 * 2 ** map.getZoom());
  const needed = (1000 * 0.5 * metresAPixel) / 15.4;
  return Math.min(1000, Math.max(software ? 1000 : 33, needed));
}

export const sizeAt = (map) => symbolSize(map.getZoom());
