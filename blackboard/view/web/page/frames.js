// Frames of the server (blackboard/view/frame.py) and the history of those that were seen. No drawing, no document.

export const MAX_BYTES = 64 << 20; // of frames that a browser keeps

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

/** The frames of `/past`, the oldest first: each behind its length. */
export function split(buffer) {
  const view = new DataView(buffer), found = [];
  for (let at = 0; at + 4 <= buffer.byteLength;) {
    const length = view.getUint32(at, true);
    found.push(buffer.slice(at + 4, at + 4 + length));
    at += 4 + length;
  }
  return found;
}

/** The belief that stands for a subject: the agreed one, else the first consensus. */
export function best(subject) {
  return subject.beliefs.find((it) => it.kind === "agreed") || subject.beliefs.find((it) => it.kind === "consensus");
}

/** What the charts and trails need of a frame, without its beliefs. */
function digest(header) {
  const subjects = {};
  for (const [name, it] of Object.entries(header.subjects)) {
    const agreed = best(it), score = it.scores.agreed || Object.values(it.scores)[0];
    const entropy = {};
    for (const belief of it.beliefs) {
      if (belief.kind === "agreed" || belief.kind === "consensus") entropy[belief.kind + (belief.who && "/" + belief.who)] = belief.entropy;
    }
    subjects[name] = { mean: agreed && agreed.mean, truth: it.truth, entropy, scores: it.scores, inside: score && score.inside };
  }
  return { run: header.run, tick: header.tick, time: header.time, subjects };
}

/** The moments that were seen, by tick, of one run at a time; bounded in bytes. */
export class History {
  constructor(most = MAX_BYTES) {
    this.most = most;
    this.bytes = 0;
    this.moments = []; // {buffer, run, tick, time, subjects}, the oldest first
  }

  get newest() { return this.moments[this.moments.length - 1]; }

  /** Keep a frame that has a moment; another run begins anew. */
  add(buffer, header = decode(buffer)) {
    if (header.tick === null) return;
    const newest = this.newest;
    if (newest && newest.run !== header.run) {
      this.moments = [];
      this.bytes = 0;
    } else if (newest && header.tick <= newest.tick) return;
    this.moments.push({ buffer, ...digest(header) });
    this.bytes += buffer.byteLength;
    while (this.bytes > this.most && this.moments.length > 1) this.bytes -= this.moments.shift().buffer.byteLength;
  }

  /** The place of the moment of a tick, or of the last one before it. */
  index(tick) {
    let low = 0, high = this.moments.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.moments[middle].tick <= tick) low = middle; else high = middle - 1;
    }
    return low;
  }
}

/** Share of the last `window` moments up to each one in which the 95 % region held the truth; null where it is not told. */
export function coverage(moments, name, window = 50) {
  const inside = [];
  return moments.map((moment) => {
    const it = moment.subjects[name];
    if (!it || it.inside === undefined || it.inside === null) return null;
    inside.push(it.inside ? 1 : 0);
    if (inside.length > window) inside.shift();
    return inside.reduce((a, b) => a + b, 0) / inside.length;
  });
}
