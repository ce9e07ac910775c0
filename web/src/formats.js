// Numbers and codes as text for people: knots, nautical miles, degrees and minutes, UTC.

export const NM_M = 1852;
const MISSING = '–';

/** 50°48.12'N 001°06.30'W */
export function position(lat, lon) {
  return `${degreesMinutes(lat, 2, 'N', 'S')} ${degreesMinutes(lon, 3, 'E', 'W')}`;
}

/** @param {number} digits of the whole degrees */
function degreesMinutes(value, digits, positive, negative) {
  const hundredths = Math.round(Math.abs(value) * 6000); // of a minute: rounded once, so that 59.999' becomes the next degree
  const degrees = Math.floor(hundredths / 6000);
  const minutes = (hundredths % 6000) / 100;
  return `${String(degrees).padStart(digits, '0')}°${minutes.toFixed(2).padStart(5, '0')}'${value < 0 ? negative : positive}`;
}

const present = (value) => value !== null && value !== undefined && !Number.isNaN(value);

export const speed = (knots) => (present(knots) ? `${knots.toFixed(1)} kn` : MISSING);
export const course = (degrees) => (present(degrees) ? `${String(Math.round(degrees) % 360).padStart(3, '0')}°` : MISSING);
export const text = (value) => (present(value) && value !== '' ? String(value) : MISSING);
export const miles = (metres) => `${(metres / NM_M).toFixed(metres < 18520 ? 2 : 1)} NM`;

/** Metres, or nautical miles from 10 km on. */
export function length(metres) {
  if (!present(metres)) return MISSING;
  return metres < 10000 ? `${metres < 10 ? metres.toFixed(1) : Math.round(metres)} m` : miles(metres);
}

/** 12 s, 3 min, 2 h 05 min, 4 d 03 h */
export function duration(seconds) {
  if (!present(seconds)) return MISSING;
  const s = Math.max(0, Math.round(seconds));
  if (s < 100) return `${s} s`;
  const minutes = Math.round(s / 60);
  if (minutes < 60) return `${minutes} min`;
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return `${hours} h ${String(minutes % 60).padStart(2, '0')} min`;
  return `${Math.floor(hours / 24)} d ${String(hours % 24).padStart(2, '0')} h`;
}

/** Unix seconds as 12:34:56 */
export const clock = (seconds) => new Date(seconds * 1000).toISOString().slice(11, 19);
/** Unix seconds as 2026-11-23 12:34:56 */
export const dateClock = (seconds) => new Date(seconds * 1000).toISOString().slice(0, 19).replace('T', ' ');
/** Text of the API as Unix seconds; NaN where there is none. */
export const seconds = (utc) => (utc ? Date.parse(utc) / 1000 : NaN);

export const CLASSES = ['cargo', 'tanker', 'passenger', 'fishing', 'service', 'pleasure', 'military'];

/** Class of an ITU-R M.1371-5 ship type (table 53), empty where the type is of none; as `coastwatch.batches.classes`. */
export function shipClass(type) {
  if (type >= 70 && type < 80) return 'cargo';
  if (type >= 80 && type < 90) return 'tanker';
  if (type >= 40 && type < 50) return 'passenger';
  if (type >= 60 && type < 70) return 'passenger';
  if (type === 30) return 'fishing';
  if (type === 35 || type === 55) return 'military';
  if (type === 36 || type === 37) return 'pleasure';
  if ((type >= 31 && type <= 34) || (type >= 50 && type <= 54)) return 'service';
  return '';
}

/** Name of a vessel for labels: its name, else its MMSI, else its number. */
export const label = (id, details) => details?.name || details?.mmsi || `#${id}`;
