// The avatar at rest: a short clip that repeats for ever without the hiccup that `<video loop>` makes at every turn,
// and whose phase is known at any time.

import { mimeType } from "./codecs.js";
import { watchFrames } from "./frames.js";
import { difference, PhaseTracker } from "./phase.js";
import { openSource } from "./source.js";

const AHEAD_SECONDS = 20; // hidden tabs run timers rarely
const BEHIND_SECONDS = 10; // room to step back while following
const SEEK_FRAMES = 6; // errors above this are jumped over, smaller ones run out by playing faster or slower
const SEEK_SECONDS = 0.06; // what a jump itself costs
const SEEK_PAUSE_MS = 600;
const DEAD_FRAMES = 0.3; // errors below this are left alone
const MAX_RATE_CHANGE = 0.25;

export class IdleLoop {
  #video;
  #tracker = null;
  #start = 0; // media time of the first frame of the clip
  #stopWatching = () => {};
  #source = null;
  #objectUrl = "";
  #turns = 0;
  #appending = false;
  #wanted = null;
  #lastSeek = 0;
  #bytes = null;
  #loads = 0;
  #listening = new AbortController();

  constructor(video) {
    this.#video = video;
    video.muted = true;
    for (const name of ["timeupdate", "waiting", "stalled"]) video.addEventListener(name, () => this.#feed());
    const { signal } = this.#listening;
    const onVisible = () => !document.hidden && this.#tracker && video.play().catch(() => {});
    document.addEventListener("visibilitychange", onVisible, { signal });
  }

  get frames() {
    return this.#tracker?.frames ?? 1;
  }

  get fps() {
    return this.#tracker?.fps ?? 25;
  }

  /** Shows the clip at `url` (`fps` frames a second). Raises what `fetch` raises, or an Error when it cannot be got. */
  async load(url, fps) {
    const { signal } = this.#listening;
    this.#loads += 1;
    const load = this.#loads;
    const stillWanted = () => {
      signal.throwIfAborted();
      if (load !== this.#loads) throw new DOMException("another clip is being loaded", "AbortError");
    };
    const answer = await fetch(url, { signal });
    if (!answer.ok) throw new Error(`The idle clip could not be loaded (${answer.status}).`);
    const bytes = new Uint8Array(await answer.arrayBuffer());
    stillWanted();
    this.#bytes = bytes;
    this.#clear();
    let seconds;
    try {
      seconds = await this.#openSeamless();
    } catch {
      stillWanted();
      seconds = await this.#openPlain();
    }
    stillWanted();
    this.#tracker = new PhaseTracker(fps, Math.max(1, Math.round(seconds * fps)));
    this.#stopWatching = watchFrames(this.#video, (time, { mediaTime }) => this.#onFrame(time, mediaTime));
    this.#feed();
    await this.#video.play().catch(() => {}); // muted video may play; where it may not, the poster stays
  }

  /** Loop frame (fractional) on the screen at page time `time` in ms, or null while unknown. */
  at(time) {
    return this.#tracker?.at(time) ?? null;
  }

  /** Keeps to the phase that `wanted(time)` gives; meant for the time in which the clip is covered. */
  follow(wanted) {
    this.#wanted = wanted;
  }

  unfollow() {
    this.#wanted = null;
    this.#video.playbackRate = 1;
  }

  /** The element is not needed any more. */
  release() {
    this.#listening.abort();
    this.#clear();
    this.#video.removeAttribute("src");
    this.#video.load();
  }

  #clear() {
    this.#stopWatching();
    this.unfollow();
    this.#source?.release();
    if (this.#objectUrl) URL.revokeObjectURL(this.#objectUrl);
    this.#source = null;
    this.#objectUrl = "";
    this.#tracker = null;
    this.#turns = 0;
    this.#appending = false;
  }

  async #openSeamless() {
    this.#video.loop = false;
    this.#source = await openSource(this.#video, mimeType(this.#bytes));
    try {
      await this.#source.append(this.#bytes);
      const { buffered } = this.#source.buffer;
      if (buffered.length !== 1) throw new Error("the idle clip has gaps");
      this.#start = buffered.start(0);
      this.#turns = 1;
      this.#video.currentTime = this.#start;
      return buffered.end(0) - buffered.start(0);
    } catch (error) {
      this.#source.release();
      this.#source = null;
      throw error;
    }
  }

  async #openPlain() {
    this.#objectUrl = URL.createObjectURL(new Blob([this.#bytes], { type: "video/mp4" }));
    this.#start = 0;
    this.#video.loop = true;
    this.#video.src = this.#objectUrl;
    await new Promise((resolve, reject) => {
      this.#video.addEventListener("loadedmetadata", resolve, { once: true });
      this.#video.addEventListener("error", () => reject(new Error("The idle clip cannot be played.")), { once: true });
    });
    return this.#video.duration;
  }

  async #feed() {
    if (!this.#source || !this.#tracker || this.#appending) return;
    this.#appending = true;
    const source = this.#source;
    const turnSeconds = this.#tracker.frames / this.#tracker.fps;
    try {
      while (source === this.#source && this.#turns * turnSeconds < this.#video.currentTime + AHEAD_SECONDS) {
        await source.append(this.#bytes, this.#turns * turnSeconds);
        this.#turns += 1;
        const oldest = this.#video.currentTime - BEHIND_SECONDS;
        if (source.start < oldest - turnSeconds) await source.remove(0, oldest);
      }
    } catch {
      if (source === this.#source) await this.#fallBack();
    } finally {
      if (source === this.#source) this.#appending = false;
    }
  }

  async #fallBack() {
    const { fps, frames } = this.#tracker;
    this.#clear();
    await this.#openPlain();
    this.#tracker = new PhaseTracker(fps, frames);
    this.#stopWatching = watchFrames(this.#video, (time, { mediaTime }) => this.#onFrame(time, mediaTime));
    await this.#video.play().catch(() => {});
  }

  #onFrame(time, mediaTime) {
    this.#tracker.observe(Math.round((mediaTime - this.#start) * this.#tracker.fps), time);
    const wanted = this.#wanted?.(time) ?? null;
    const actual = this.#tracker.at(time);
    if (wanted === null || actual === null) return;
    const behind = difference(wanted, actual, this.#tracker.frames);
    if (Math.abs(behind) > SEEK_FRAMES) this.#seek(behind / this.#tracker.fps, time);
    else this.#setRate(behind);
  }

  #seek(seconds, time) {
    if (time - this.#lastSeek < SEEK_PAUSE_MS) return;
    this.#lastSeek = time;
    const turnSeconds = this.#tracker.frames / this.#tracker.fps;
    let target = this.#video.currentTime + seconds + SEEK_SECONDS;
    if (target < this.#start) target += turnSeconds;
    if (!this.#source && target >= turnSeconds) target -= turnSeconds;
    this.#tracker.reset();
    this.#video.currentTime = target;
  }

  #setRate(behind) {
    const change = Math.abs(behind) < DEAD_FRAMES ? 0 : Math.max(-MAX_RATE_CHANGE, Math.min(MAX_RATE_CHANGE, behind / 10));
    const rate = 1 + Math.round(change * 50) / 50;
    if (this.#video.playbackRate !== rate) this.#video.playbackRate = rate;
  }
}
