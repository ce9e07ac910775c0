// Names of vessels as pictures on one canvas: text with an edge is costly to draw, a copy of its picture is not.

const FONT = '12px system-ui, sans-serif';
const BOLD = `bold ${FONT}`;
const ROW = 18; // CSS pixels
const EDGE = 3; // room on each side for the edge of the letters
const BASE = 14; // of the letters below the top of a row
const WIDE = 1024; // CSS pixels of the canvas
const ROWS = 56;

export class Names {
  #canvas = document.createElement('canvas');
  #known = new Map();
  #ratio = 0;
  #x = 0;
  #row = 0;

  /** Forgets all pictures. */
  #clear() {
    this.#known.clear();
    this.#ratio = devicePixelRatio;
    this.#canvas.width = WIDE * this.#ratio;
    this.#canvas.height = ROWS * ROW * this.#ratio;
    this.#x = 0;
    this.#row = 0;
    this.context = this.#canvas.getContext('2d');
    this.context.setTransform(this.#ratio, 0, 0, this.#ratio, 0, 0);
    this.context.lineJoin = 'round';
    this.context.lineWidth = 3;
  }

  /**
   * The picture of a text, made at the first call. A colour has one weight.
   * @returns {{x: number, y: number, width: number}} its place on the canvas, and the width of the text in CSS pixels
   */
  of(text, colour, halo, bold = false) {
    if (this.#ratio !== devicePixelRatio) this.#clear();
    const key = `${text}|${colour}|${halo}`;
    const known = this.#known.get(key);
    if (known) return known;
    this.context.font = bold ? BOLD : FONT;
    const width = Math.min(this.context.measureText(text).width, WIDE - 2 * EDGE);
    if (this.#x + width + 2 * EDGE > WIDE) [this.#x, this.#row] = [0, this.#row + 1];
    if (this.#row >= ROWS) this.#clear();
    this.context.font = bold ? BOLD : FONT; // a cleared canvas has lost it
    const made = { x: this.#x, y: this.#row * ROW, width };
    this.#x += Math.ceil(width) + 2 * EDGE;
    this.context.strokeStyle = halo;
    this.context.strokeText(text, made.x + EDGE, made.y + BASE, width);
    this.context.fillStyle = colour;
    this.context.fillText(text, made.x + EDGE, made.y + BASE, width);
    this.#known.set(key, made);
    return made;
  }

  /** Draws a picture whose text begins at a place. Args: left, top: CSS pixels; the letters stand 11 below the top. */
  draw(context, { x, y, width }, left, top) {
    const ratio = this.#ratio;
    const wide = Math.ceil(width) + 2 * EDGE;
    context.drawImage(
      this.#canvas, x * ratio, y * ratio, wide * ratio, ROW * ratio, Math.round(left) - EDGE, Math.round(top) + 11 - BASE, wide, ROW,
    );
  }
}
