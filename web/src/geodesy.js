// Positions on the web mercator square, and what a watch officer measures: range, bearing, closest approach.

export const KNOT_M_S = 1852 / 3600;
/** Metres of one degree of latitude. The server foretells positions with the same figure. */
export const METRES_A_DEGREE = 111120;
const EARTH_RADIUS_M = 6371008.8;
const RAD = Math.PI / 180;

/** @returns {number} x of a longitude on the square, 0 at 180 W, 1 at 180 E */
export const mercatorX = (lon) => (lon + 180) / 360;

/** @returns {number} y of a latitude on the square, 0 in the north, 1 in the south */
export function mercatorY(lat) {
  const sine = Math.sin(lat * RAD);
  return 0.5 - Math.log((1 + sine) / (1 - sine)) / (4 * Math.PI);
}

/** Radii of curvature of the ellipsoid WGS 84 at a latitude, in metres: along the parallel's plane and along the meridian. */
export function radii(lat) {
  const flattening = 1 / 298.257223563;
  const eccentricity2 = flattening * (2 - flattening);
  const w2 = 1 - eccentricity2 * Math.sin(lat * RAD) ** 2;
  return { east: 6378137 / Math.sqrt(w2), north: (6378137 * (1 - eccentricity2)) / w2 ** 1.5 };
}

/** Longitude, brought into -180 to 180. */
export const wrapped = (lon) => ((((lon + 180) % 360) + 360) % 360) - 180;

/**
 * Where a vessel is after some seconds of straight motion: the formula of the server, which sends a vessel only when this fails.
 * @param {number} lat degrees
 * @param {number} lon degrees
 * @param {number} sog knots; NaN: unknown, taken as 0
 * @param {number} cog degrees true
 * @param {number} seconds
 * @returns {[number, number]} latitude, longitude in degrees
 */
export function ahead(lat, lon, sog, cog, seconds) {
  const way = ((sog || 0) * KNOT_M_S * seconds) / METRES_A_DEGREE;
  const course = cog * RAD;
  return [lat + way * Math.cos(course), lon + (way * Math.sin(course)) / Math.cos(lat * RAD)];
}

/** Metres east and north from one place to another near it: at most some hundred kilometres. */
export function offsetM(fromLat, fromLon, toLat, toLon) {
  const middle = ((fromLat + toLat) / 2) * RAD;
  return [wrapped(toLon - fromLon) * Math.cos(middle) * METRES_A_DEGREE, (toLat - fromLat) * METRES_A_DEGREE];
}

/** Range in metres and true bearing in degrees between two places, on the sphere. */
export function rangeBearing(fromLat, fromLon, toLat, toLon) {
  const a = fromLat * RAD;
  const b = toLat * RAD;
  const turn = (toLon - fromLon) * RAD;
  const chord = Math.sin((b - a) / 2) ** 2 + Math.cos(a) * Math.cos(b) * Math.sin(turn / 2) ** 2;
  const east = Math.sin(turn) * Math.cos(b);
  const north = Math.cos(a) * Math.sin(b) - Math.sin(a) * Math.cos(b) * Math.cos(turn);
  return [2 * EARTH_RADIUS_M * Math.asin(Math.min(1, Math.sqrt(chord))), (Math.atan2(east, north) / RAD + 360) % 360];
}

/**
 * Closest approach of two vessels that keep course and speed.
 * @param {{lat: number, lon: number, sog: number, cog: number}} own degrees and knots
 * @param {{lat: number, lon: number, sog: number, cog: number}} other
 * @returns {{distance_m: number, time_s: number}} time is negative where they already draw apart
 */
export function closestApproach(own, other) {
  const [x, y] = offsetM(own.lat, own.lon, other.lat, other.lon);
  const rate = ({ sog, cog }) => [(sog || 0) * KNOT_M_S * Math.sin(cog * RAD), (sog || 0) * KNOT_M_S * Math.cos(cog * RAD)];
  const [a, b] = [rate(own), rate(other)];
  const [u, v] = [b[0] - a[0], b[1] - a[1]];
  const speed = u * u + v * v;
  const time = speed > 1e-6 ? -(x * u + y * v) / speed : 0;
  return { distance_m: Math.hypot(x + u * time, y + v * time), time_s: time };
}
