// What a vessel looks like: symbol by source after IMO SN.1/Circ.243, colours of day, dusk and night after IHO S-52.

/** Symbols; the shader of points.js draws them by these numbers. */
export const SYMBOL = { lost: 0, ais: 1, radar: 2, fused: 3, bearing: 4 };
/** Bits of the column `flag`. */
export const FLAG = { dark: 1, unseen: 2, contradicted: 4, twice: 8, speed: 16, coasting: 32, alarm: 64 };
/** What filters, declutter and zoom never hide: distress, an alarm, a lost vessel (IEC 62288). */
export const ALWAYS_SHOWN = FLAG.alarm | FLAG.coasting;
/** Bits that draw a ring about the symbol. */
export const RINGED = FLAG.dark | FLAG.unseen | FLAG.contradicted | FLAG.twice | FLAG.speed;

const FLAG_NAMES = [
  [FLAG.alarm, 'alarm'],
  [FLAG.dark, 'dark'],
  [FLAG.contradicted, 'AIS contradicted'],
  [FLAG.twice, 'MMSI twice'],
  [FLAG.speed, 'impossible speed'],
  [FLAG.unseen, 'AIS without radar'],
  [FLAG.coasting, 'coasting'],
];

/** Symbol of a vessel by its sources: a sum of 1 AIS, 2 radar, 4 bearing. */
export function symbolOf(kind, flag) {
  if (kind === 0 || flag & FLAG.coasting) return SYMBOL.lost;
  return kind & 3 || SYMBOL.bearing;
}

/** Sources of a vessel in words. */
export function sourceWords(kind) {
  const words = ['AIS', 'radar', 'bearing'].filter((_, bit) => kind & (1 << bit));
  return words.length ? words.join(' + ') : 'no sensor now';
}

/** Flags in words, the gravest first. */
export const flagWords = (flag) => FLAG_NAMES.filter(([bit]) => flag & bit).map(([, name]) => name);

/** How grave the flags are, for sorting: the first of FLAG_NAMES counts most. */
export const gravity = (flag) => FLAG_NAMES.reduce((sum, [bit], k) => sum + (flag & bit ? 2 ** (FLAG_NAMES.length - k) : 0), 0);

/**
 * Colours as red, green, blue of 255. Sea, land and shore are those of S-52. Symbols by day and dusk are darker or brighter than
 * the table, so that each has 3:1 against sea and land. By night symbols have the greatest luminance of the table, and no more.
 */
export const THEMES = {
  day: {
    sea: [212, 234, 238], land: [201, 185, 122], shore: [82, 90, 92],
    ais: [12, 58, 168], radar: [0, 84, 48], fused: [7, 7, 7], bearing: [122, 52, 0], lost: [74, 74, 74],
    alarm: [176, 0, 32], flagged: [142, 0, 122], selected: [7, 7, 7], cover: [60, 90, 60], echo: [176, 84, 0],
    text: [20, 24, 26], soft: [70, 78, 82], panel: [246, 248, 248], edge: [150, 160, 164], row: [228, 236, 238], focus: [12, 58, 168],
    warn: [156, 92, 0], grave: [176, 0, 32], ongrave: [255, 255, 255],
  },
  dusk: {
    sea: [7, 7, 7], land: [44, 41, 27], shore: [96, 104, 104],
    ais: [104, 150, 255], radar: [70, 176, 122], fused: [206, 210, 210], bearing: [222, 138, 60], lost: [150, 150, 150],
    alarm: [255, 92, 92], flagged: [232, 104, 224], selected: [222, 222, 222], cover: [60, 96, 70], echo: [190, 148, 40],
    text: [206, 210, 208], soft: [156, 162, 160], panel: [20, 21, 20], edge: [70, 76, 74], row: [38, 41, 40], focus: [104, 150, 255],
    warn: [240, 176, 64], grave: [255, 92, 92], ongrave: [7, 7, 7],
  },
  night: {
    sea: [7, 7, 7], land: [13, 10, 8], shore: [37, 41, 41],
    ais: [28, 38, 110], radar: [10, 54, 24], fused: [43, 48, 48], bearing: [73, 38, 10], lost: [46, 47, 47],
    alarm: [98, 9, 7], flagged: [82, 16, 80], selected: [43, 48, 48], cover: [12, 31, 21], echo: [58, 40, 8],
    text: [138, 126, 112], soft: [136, 124, 110], panel: [7, 7, 7], edge: [40, 38, 36], row: [20, 19, 18], focus: [84, 80, 74],
    warn: [126, 90, 20], grave: [50, 5, 4], ongrave: [138, 126, 112],
  },
};
/** Greatest relative luminance of the chart by night: UINFD, the brightest colour of the night table of S-52. */
export const NIGHT_LUMINANCE = luminance([43, 48, 48]);
/** Widths of the lines of symbols in CSS pixels: where luminance is limited, wider lines are what can be seen. */
export const STROKE_PX = { day: 1.5, dusk: 1.5, night: 2.2 };
/** Colours that draw symbols on the chart: those of SYMBOL in its order, then others. */
export const SYMBOL_COLOURS = ['lost', 'ais', 'radar', 'fused', 'bearing', 'alarm', 'flagged', 'selected'];

/** Relative luminance of a colour, 0 to 1. Source: W3C, WCAG 2.2, "relative luminance". */
export function luminance([red, green, blue]) {
  const linear = (value) => (value <= 10.31475 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  return 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue);
}

/** Contrast of two colours, 1 to 21. Source: W3C, WCAG 2.2, "contrast ratio". */
export function contrast(one, other) {
  const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}

/** A colour for CSS and canvas. */
export const css = ([red, green, blue], opacity = 1) => `rgba(${red},${green},${blue},${opacity})`;

/** Size of symbols in CSS pixels: dots of a whole coast, small symbols, full symbols. */
export const symbolSize = (zoom) => (zoom < 7 ? 3 : zoom < 9 ? 9 : 18);
