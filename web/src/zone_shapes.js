// Zones as values: what the server takes and gives, what was clicked, what is drawn of it.

import { METRES_A_DEGREE, rangeBearing, wrapped } from './geodesy.js';

const MILE_M = 1852;
/** The words for a zone without rules. */
export const NO_RULE = 'no alarm';
/** Clicks that a shape needs. */
export const NEEDED = { polygon: 3, circle: 2, line: 2 };

/**
 * A zone as the server takes it.
 * @param {{name: string, kind: string, [rule: string]: any}} form values of the form; empty ones are left out
 * @param {[number, number][]} points latitude, longitude of each click; of a circle its centre and a place on it
 */
export function definitionOf({ name, kind, ...rules }, points) {
  const zone = { name: name.trim(), kind };
  if (kind === 'circle') {
    const [[lat, lon], [toLat, toLon]] = points;
    zone.centre_deg = [lat, wrapped(lon)];
    zone.radius_nm = Math.max(rangeBearing(lat, lon, toLat, toLon)[0] / MILE_M, 0.001);
  } else zone.points_deg = points.map(([lat, lon]) => [lat, wrapped(lon)]);
  const of = kind === 'line' ? ['crossing'] : ['enter', 'leave', 'dwell_s', 'min_speed_kn', 'max_speed_kn'];
  for (const rule of of) if (rules[rule]) zone[rule] = rules[rule];
  return zone;
}

/** The points that were clicked for a zone of the server, as `definitionOf` takes them. */
export function pointsOf({ kind, points_deg, centre_deg, radius_nm }) {
  return kind === 'circle' ? [centre_deg, [centre_deg[0] + (radius_nm * MILE_M) / METRES_A_DEGREE, centre_deg[1]]] : points_deg;
}

/** What is drawn so far, as GeoJSON: a line through the points, and for a circle about its centre. */
export function draftOf(kind, points) {
  let places = points.map(([lat, lon]) => [lon, lat]);
  if (kind === 'circle' && points.length === 2) {
    const [[lat, lon], to] = points;
    const reach = rangeBearing(lat, lon, ...to)[0] / METRES_A_DEGREE;
    places = Array.from({ length: 73 }, (_, k) => (k * Math.PI) / 36)
      .map((angle) => [lon + (reach * Math.sin(angle)) / Math.cos((lat * Math.PI) / 180), lat + reach * Math.cos(angle)]);
  } else if (kind === 'polygon' && places.length > 2) places.push(places[0]);
  const corners = points.map(([lat, lon]) => feature('Point', [lon, lat]));
  return { type: 'FeatureCollection', features: [feature('LineString', places), ...corners] };
}

const feature = (type, coordinates) => ({ type: 'Feature', properties: {}, geometry: { type, coordinates } });

/** What to do next, in words. Args: count: points so far. */
export function hintOf(kind, count, drawing) {
  if (!drawing) return count ? 'Its shape stays, unless it is drawn again.' : 'Draw its shape, then save it.';
  const needed = {
    polygon: 'its corners, 3 or more', line: 'its points, 2 or more', circle: 'its centre, then a place on it',
  }[kind];
  return `Click ${needed}, or move the cross and press Enter on the chart. So far: ${count}.`
    + (count ? ' Backspace takes the last one away; Enter or a double click ends.' : '');
}

/** The rules of a zone in words. */
export function ruleWords(zone) {
  return [
    zone.enter && 'enter', zone.leave && 'leave', zone.dwell_s && `stay over ${Math.round(zone.dwell_s / 6) / 10} min`,
    zone.min_speed_kn && `under ${zone.min_speed_kn} kn`, zone.max_speed_kn && `over ${zone.max_speed_kn} kn`,
    zone.crossing && zone.crossing !== 'none' && `cross ${zone.crossing.replaceAll('_', ' ')}`,
  ].filter(Boolean).join(', ') || NO_RULE;
}
