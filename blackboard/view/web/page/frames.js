// Frames of the server (blackboard/view/frame.py) the lines of moments that are over, and a cache. No drawing, no document.

export const MAX_BYTES = 32 << 20; // of frames that a browser keeps

const text = new TextDecoder();

/** A frame: its header, and each belief with its bytes as `levels`. */
export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(text.decode(new Uint8Array(buffer, 4, length)));
  let begin = 4 + length;
  for (const subject of Object.values(header.subjects)) {
    for (const belief of subject.beliefs) {
      const size = belief.box[0] * belief.box[1];
      belief.levels = new Uint8Array(buffer, begin, size);
      begin += size;
    }
  }
  return header;
}

/** The belief that stands for a subject: the agreed one, else the first consensus. */
export function best(subject) {
  return subject.beliefs.find((it) => it.kind === "agreed") || subject.beliefs.find((it) => it.kind === "consensus");
}

/** The line of a frame, as the server makes it for `/past`: what charts and trails need of a moment. */
export function lineOf(header) {
  const subjects = {};
  for (const [name, it] of Object.entries(header.subjects)) {
    subjects[name] = { mean: best(it)?.mean ?? null, truth: it.truth, entropy: it.entropy, scores: it.scores };
  }
  return { run: header.run, tick: header.tick, time: header.time, subjects };
}

/** The score that stands for a subject of a line: that of the agreed belief, else of the first consensus. */
export function score(subject) {
  return subject && (subject.scores.agreed || Object.values(subject.scores)[0]);
}

/** The lines of all moments that can be gone back to, by tick, of one run at a time. */
export class History {
  constructor() { this.moments = []; this.asked = 0; } // `asked`: how many the server had made when it was asked last

  get newest() { return this.moments[this.moments.length - 1]; }

  /** Put a line in its place; another run begins anew. */
  add(line) {
    if (line.tick === null) return;
    if (this.newest && this.newest.run !== line.run) { this.moments = []; this.asked = 0; }
    if (!this.newest || line.tick > this.newest.tick) { this.moments.push(line); return; }
    const at = this.index(line.tick);
    if (this.moments[at].tick === line.tick) return;
    this.moments.splice(this.moments[at].tick < line.tick ? at + 1 : at, 0, line);
  }

  /** The lines of so many seconds, with a time in their middle where there are as many on both sides of it. */
  around(time, seconds) {
    const begin = Math.max(this.moments[0].time, Math.min(time - seconds / 2, this.newest.time - seconds));
    return this.moments.filter((it) => it.time >= begin - 1e-6 && it.time <= begin + seconds + 1e-6);
  }

  /** The answer of `/past`. */
  extend({ made, lines }) {
    for (const line of lines) this.add(line);
    this.asked = made;
  }

  /** Forget what the server keeps no longer: the moments up to a tick. */
  drop(tick) { this.moments = this.moments.filter((it) => it.tick > tick); }

  /** The place of the moment of a tick, or of the last one before it. */
  index(tick) { return this.last((it) => it.tick <= tick); }

  /** The place of the last moment that is not later than a team time. */
  before(time) { return this.last((it) => it.time <= time); }

  last(holds) {
    let low = 0, high = this.moments.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (holds(this.moments[middle])) low = middle; else high = middle - 1;
    }
    return low;
  }
}

/** Frames of moments by name, the ones used last; bounded in bytes. */
export class Cache {
  constructor(most = MAX_BYTES) { this.most = most; this.bytes = 0; this.kept = new Map(); }

  get(name) {
    const found = this.kept.get(name);
    if (found) { this.kept.delete(name); this.kept.set(name, found); }
    return found;
  }

  put(name, buffer) {
    if (this.kept.has(name)) return;
    this.kept.set(name, buffer);
    this.bytes += buffer.byteLength;
    for (const [oldest, it] of this.kept) {
      if (this.bytes <= this.most || this.kept.size === 1) return;
      this.kept.delete(oldest);
      this.bytes -= it.byteLength;
    }
  }
}

/** Share of the last `window` moments up to each one in which the 95 % region held the truth, in part where that is on its border; null where it is not told. */
export function coverage(moments, name, window = 50) {
  const held = [];
  return moments.map((moment) => {
    const it = score(moment.subjects[name]);
    if (!it) return null;
    held.push(it.held);
    if (held.length > window) held.shift();
    return held.reduce((a, b) => a + b, 0) / held.length;
  });
}
