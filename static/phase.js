// Arithmetic of a looping clip: where in the loop something is, and how far apart two places are.

const KEPT_SAMPLES = 7;
const JUMP_MS = 60; // a sample this far from the others is a seek or a hiccup, not jitter
const STALE_MS = 1000; // a clip that has shown nothing new for this long is standing still

/** `value` brought into [0, length). */
export function wrap(value, length) {
  return ((value % length) + length) % length;
}

/** The shortest way from `b` to `a` on a loop, in [-length / 2, length / 2). */
export function difference(a, b, length) {
  return wrap(a - b + length / 2, length) - length / 2;
}

/** Knows which frame of a loop is on the screen at any time, from the frames seen so far. */
export class PhaseTracker {
  #offsets = []; // ms between the time a frame was shown and its place in the loop
  #seen = -Infinity;

  /** fps: frames a second; frames: length of the loop. */
  constructor(fps, frames) {
    this.fps = fps;
    this.frames = frames;
  }

  reset() {
    this.#offsets = [];
  }

  /** Frame number `frame` (may grow without bound) appeared at page time `time` (ms). */
  observe(frame, time) {
    const offset = time - (frame * 1000) / this.fps;
    if (this.#offsets.length > 0 && Math.abs(offset - this.#median()) > JUMP_MS) this.reset();
    this.#offsets.push(offset);
    if (this.#offsets.length > KEPT_SAMPLES) this.#offsets.shift();
    this.#seen = time;
  }

  /** Loop frame in [0, frames), fractional, at page time `time`; null when nothing recent is known. */
  at(time) {
    if (this.#offsets.length === 0 || time - this.#seen > STALE_MS) return null;
    return wrap(((time - this.#median()) * this.fps) / 1000, this.frames);
  }

  // The display shows frames on its own beat, so single samples are off by up to one refresh either way.
  #median() {
    const sorted = [...this.#offsets].sort((a, b) => a - b);
    return sorted[sorted.length >> 1];
  }
}
