// Drawing: colours, densities, contours, charts. Coordinates of the arena are in its unit; y points up.

/** Cividis (Nuñez, Anderton and Renslow 2018), a few of its colours; those between them are mixed. */
const CIVIDIS = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116],
  [195, 179, 105], [225, 204, 85], [254, 232, 56]];
/** As blackboard/view/tui/heat.py has them: on black, and darker ones on white. */
const ON_DARK = ["#e69f00", "#56b4e9", "#00b283", "#e07ab8", "#f0e442", "#e8503a", "#9a7bff", "#c4ccd4"];
const ON_LIGHT = ["#b97d00", "#2f8fc9", "#007a59", "#b8418c", "#8a8000", "#c8321c", "#6a4be0", "#5b6670"];

export const TABLE = new Uint8Array(256 * 3);
for (let i = 0; i < 256; i++) {
  const at = (i / 255) * (CIVIDIS.length - 1), k = Math.min(Math.floor(at), CIVIDIS.length - 2), t = at - k;
  for (let c = 0; c < 3; c++) TABLE[3 * i + c] = Math.round(CIVIDIS[k][c] * (1 - t) + CIVIDIS[k + 1][c] * t);
}

/** The colour of a subject by its place among all. */
export function colour(index, light) { return (light ? ON_LIGHT : ON_DARK)[index % ON_DARK.length]; }

/** A canvas as large as it is shown, in the pixels of the screen; its context in CSS pixels. */
export function prepare(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 3), box = canvas.getBoundingClientRect();
  const width = Math.max(1, Math.round(box.width * ratio)), height = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, box.width, box.height);
  return { context, width: box.width, height: box.height };
}

/** Where points of the arena are on a canvas: the window [x0, x1] x [y0, y1] fits in, undistorted. */
export function projection(x0, x1, y0, y1, width, height, margin) {
  const scale = Math.min((width - 2 * margin) / (x1 - x0), (height - 2 * margin) / (y1 - y0));
  const left = (width - scale * (x1 - x0)) / 2, low = (height + scale * (y1 - y0)) / 2;
  return { scale, x: (x) => left + (x - x0) * scale, y: (y) => low - (y - y0) * scale };
}

/** The level of a cell of a belief (0 outside its box), by its indices on the whole grid. */
export function level(belief, ix, iy) {
  const i = ix - belief.lo[0], j = iy - belief.lo[1];
  return i >= 0 && j >= 0 && i < belief.box[0] && j < belief.box[1] ? belief.levels[i * belief.box[1] + j] : 0;
}

/** The cell of the greatest probability, as [ix, iy]. */
export function peak(belief) {
  const k = belief.levels.indexOf(255);
  return [belief.lo[0] + Math.floor(k / belief.box[1]), belief.lo[1] + (k % belief.box[1])];
}

/** How many points a contour has between the centres of two cells. */
const FINE = 4;

/** Catmull and Rom's spline through four values, at 0 to 1 between the middle two. */
function spline(a, b, c, d, t) {
  return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

/** The levels of a belief at points FINE times as dense as its cells, with a border of two cells around the box. */
function refined(belief) {
  const [nx, ny] = belief.box, width = (nx + 3) * FINE + 1, height = (ny + 3) * FINE + 1;
  const at = (i, j) => (i >= 0 && j >= 0 && i < nx && j < ny ? belief.levels[i * ny + j] : 0);
  const rows = new Float32Array((nx + 6) * height), found = new Float32Array(width * height);
  for (let i = 0; i < nx + 6; i++) {
    for (let y = 0; y < height; y++) {
      const j = Math.floor(y / FINE) - 2;
      rows[i * height + y] = spline(at(i - 3, j - 1), at(i - 3, j), at(i - 3, j + 1), at(i - 3, j + 2), (y % FINE) / FINE);
    }
  }
  for (let x = 0; x < width; x++) {
    const i = Math.min(Math.floor(x / FINE), nx + 2) * height, t = x / FINE - Math.min(Math.floor(x / FINE), nx + 2);
    for (let y = 0; y < height; y++) {
      found[x * height + y] = spline(rows[i + y], rows[i + height + y], rows[i + 2 * height + y], rows[i + 3 * height + y], t);
    }
  }
  return { found, width, height };
}

/**
 * The contour of a belief's 95 % region as pieces [x, y, x, y] in cells: marching squares on the logarithms of the
 * probabilities, refined by a spline, so that the contour of a Gaussian is smooth.
 */
export function contour(belief) {
  const iso = Math.max(0.5, belief.edge - 0.5), pieces = [], { found, width, height } = refined(belief);
  const cross = (a, b) => (a === b ? 0.5 : (iso - a) / (b - a));
  const [lx, ly] = belief.lo.map((it) => it - 1.5); // the first point is the centre of the cell two before the box
  for (let i = 0; i + 1 < width; i++) {
    for (let j = 0; j + 1 < height; j++) {
      const k = i * height + j, a = found[k], b = found[k + height], c = found[k + height + 1], d = found[k + 1];
      const corner = (a > iso) | ((b > iso) << 1) | ((c > iso) << 2) | ((d > iso) << 3);
      if (corner === 0 || corner === 15) continue;
      const edges = { s: [i + cross(a, b), j], e: [i + 1, j + cross(b, c)], n: [i + cross(d, c), j + 1], w: [i, j + cross(a, d)] };
      for (const [from, to] of PIECES[corner]) {
        const [x, y] = edges[from], [u, v] = edges[to];
        pieces.push([lx + x / FINE, ly + y / FINE, lx + u / FINE, ly + v / FINE]);
      }
    }
  }
  return pieces;
}

const PIECES = { 1: ["ws"], 2: ["se"], 3: ["we"], 4: ["en"], 5: ["ws", "en"], 6: ["sn"], 7: ["wn"], 8: ["nw"], 9: ["ns"],
  10: ["se", "nw"], 11: ["ne"], 12: ["ew"], 13: ["es"], 14: ["sw"] };
for (const key of Object.keys(PIECES)) PIECES[key] = PIECES[key].map((it) => it.split(""));

/** A picture of a belief's box, a pixel a cell; `paint(level)` gives [r, g, b, alpha]. */
export function picture(belief, paint) {
  const [nx, ny] = belief.box, canvas = document.createElement("canvas");
  canvas.width = nx; canvas.height = ny;
  const image = new ImageData(nx, ny);
  for (let i = 0; i < nx; i++) {
    for (let j = 0; j < ny; j++) image.data.set(paint(belief.levels[i * ny + j]), 4 * ((ny - 1 - j) * nx + i));
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

/** Put a belief's picture where its box is. */
export function place(context, to, grid, belief, image, smooth) {
  const x = grid.origin[0] + belief.lo[0] * grid.cell, y = grid.origin[1] + (belief.lo[1] + belief.box[1]) * grid.cell;
  context.imageSmoothingEnabled = smooth;
  context.imageSmoothingQuality = "high";
  context.drawImage(image, to.x(x), to.y(y), belief.box[0] * grid.cell * to.scale, belief.box[1] * grid.cell * to.scale);
}

/** Draw the contour of a belief. */
export function outline(context, to, grid, belief) {
  context.lineCap = context.getLineDash().length ? "butt" : "round"; // the pieces are not connected
  context.beginPath();
  for (const [x, y, u, v] of contour(belief)) {
    context.moveTo(to.x(grid.origin[0] + x * grid.cell), to.y(grid.origin[1] + y * grid.cell));
    context.lineTo(to.x(grid.origin[0] + u * grid.cell), to.y(grid.origin[1] + v * grid.cell));
  }
  context.stroke();
}

/** The height nearest to y at which a label of a width covers none of those in `labels`, to which it is added; all are a line high. */
export function apart(labels, x, y, width) {
  const covers = (at) => labels.some((it) => Math.abs(it.y - at) < LINE && x < it.x + it.width && it.x < x + width);
  const found = [0, 1, -1, 2, -2, 3, -3].map((lines) => y + lines * LINE).find((at) => at >= LINE && !covers(at)) ?? y;
  labels.push({ x, y: found, width });
  return found;
}
const LINE = 14; // pixels

/** A cross where the truth is, with a rim so that it shows on every colour. */
export function mark(context, x, y, size, ink, rim) {
  for (const [width, style] of [[4, rim], [1.8, ink]]) {
    context.lineWidth = width; context.strokeStyle = style; context.lineCap = "round";
    context.beginPath();
    context.moveTo(x - size, y - size); context.lineTo(x + size, y + size);
    context.moveTo(x - size, y + size); context.lineTo(x + size, y - size);
    context.stroke();
  }
}

/** Steps of a scale: 1, 2 or 5 times a power of ten, about `count` of them. */
export function steps(low, high, count) {
  const rough = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(rough || 1));
  const step = [1, 2, 5, 10].map((it) => it * power).find((it) => it >= rough) || power;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/** Lines over time: `series` of {values, colour, width, dash}, null where there is no value; `cursor` is an index, `rule` a value. */
export function chart(canvas, times, series, { low = 0, high = null, cursor = null, rule = null, ink, soft, line }) {
  const { context, width, height } = prepare(canvas);
  const values = series.flatMap((it) => it.values.filter((value) => value !== null && Number.isFinite(value)));
  const sorted = values.slice().sort((a, b) => a - b);
  const top = high ?? Math.max(low + 1e-3, 1.15 * (sorted[Math.floor(0.99 * (sorted.length - 1))] || 1));
  const left = 30, right = width - 6, up = 6, down = height - 16;
  const first = times[0] || 0, last = Math.max(times[times.length - 1] || 1, first + 1e-9);
  const x = (time) => left + ((time - first) / (last - first)) * (right - left);
  const y = (value) => down - ((Math.min(value, top) - low) / (top - low)) * (down - up);
  context.font = "10px system-ui, sans-serif";
  context.fillStyle = soft; context.strokeStyle = line; context.lineWidth = 1;
  context.textAlign = "right"; context.textBaseline = "middle";
  for (const value of steps(low, top, 3)) {
    context.beginPath(); context.moveTo(left, y(value)); context.lineTo(right, y(value)); context.stroke();
    context.fillText(String(value), left - 5, y(value));
  }
  context.textBaseline = "top";
  context.textAlign = "left"; context.fillText(`${first.toFixed(0)} s`, left, down + 4);
  context.textAlign = "right"; context.fillText(`${last.toFixed(0)} s`, right, down + 4);
  if (rule !== null) {
    context.setLineDash([4, 3]); context.strokeStyle = soft;
    context.beginPath(); context.moveTo(left, y(rule)); context.lineTo(right, y(rule)); context.stroke();
    context.setLineDash([]);
  }
  for (const it of series) {
    context.strokeStyle = it.colour; context.lineWidth = it.width; context.lineJoin = "round"; context.setLineDash(it.dash || []);
    context.beginPath();
    let down_ = false;
    it.values.forEach((value, index) => {
      if (value === null || value === undefined) { down_ = false; return; }
      if (down_) context.lineTo(x(times[index]), y(value)); else context.moveTo(x(times[index]), y(value));
      down_ = true;
    });
    context.stroke();
  }
  context.setLineDash([]);
  if (cursor !== null && times[cursor] !== undefined) {
    context.strokeStyle = ink; context.lineWidth = 1;
    context.beginPath(); context.moveTo(x(times[cursor]), up); context.lineTo(x(times[cursor]), down); context.stroke();
  }
  return { time: (at) => first + ((at - left) / (right - left)) * (last - first) };
}
