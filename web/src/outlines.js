// The outline of a ship true to scale, by its size by radar: IMO SN.1/Circ.243, true scale outline.

const BEAM_OF_LENGTH = 1 / 6; // where the width is unknown
const BOW = 0.2; // share of the length that narrows to the bow
const UNDER_WAY_KN = 1; // a slower ship has an axis, but its bow and stern look alike
const RAD = Math.PI / 180;

/**
 * Corners of the hull in metres east and north of its middle: with a bow where the ship is under way.
 * @param {{length: number, width: number, axis: number}} size metres, NaN where unknown, and degrees from north
 * @param {number} knots its speed, NaN where unknown
 */
export function hull({ length, width, axis }, knots) {
  const [ahead, aside] = [length / 2, (Number.isNaN(width) ? length * BEAM_OF_LENGTH : Math.min(width, length)) / 2];
  const shoulder = ahead - BOW * length;
  const corners = knots > UNDER_WAY_KN
    ? [[ahead, 0], [shoulder, aside], [-ahead, aside], [-ahead, -aside], [shoulder, -aside]]
    : [[ahead, aside], [-ahead, aside], [-ahead, -aside], [ahead, -aside]];
  const [sine, cosine] = [Math.sin(axis * RAD), Math.cos(axis * RAD)];
  return corners.map(([along, across]) => [along * sine + across * cosine, along * cosine - across * sine]);
}
