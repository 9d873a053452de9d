// Words and mouth shapes of the service's events, kept until they are heard and seen: it tells them ahead.

const CHECK_MS = 30;
const LIMIT_MS = 10_000; // a picture that has not come by then does not come
const GRACE_SECONDS = 0.008; // half a refresh of the display
const TRANSIT_MS = 80; // from leaving the service to being heard, where nothing better is known

export class Cues {
  #seam;
  #clock;
  #waiting = new Set();

  /** Called with (name, data) when it is heard. */
  onHeard = () => {};

  constructor(seam, clock) {
    this.#seam = seam;
    this.#clock = clock;
  }

  /** name: "word", "mark" or "viseme"; data: `{utterance, media_time, wall_ms, …}`. */
  add(name, data) {
    const cue = { name, data, timer: 0, giveUp: performance.now() + LIMIT_MS };
    this.#waiting.add(cue);
    this.#check(cue);
  }

  /** Forgets what is not heard any more: all of it, or what begins at `mediaTime` or later. */
  drop(mediaTime = -Infinity) {
    for (const cue of this.#waiting) {
      if (cue.data.media_time < mediaTime) continue;
      clearTimeout(cue.timer);
      this.#waiting.delete(cue);
    }
  }

  #check(cue) {
    const now = performance.now();
    const wait = this.#wait(cue.data, now);
    if (wait <= GRACE_SECONDS * 1000) {
      this.#waiting.delete(cue);
      this.onHeard(cue.name, cue.data);
    } else if (now > cue.giveUp) {
      this.#waiting.delete(cue);
    } else {
      cue.timer = setTimeout(() => this.#check(cue), wait);
    }
  }

  // Milliseconds until it is heard, or until it is worth looking again.
  #wait({ media_time: mediaTime, wall_ms: wallMs }, now) {
    if (this.#seam.expecting) return CHECK_MS; // the picture decides when speech begins
    const shown = this.#seam.mediaTimeAt(now);
    if (shown !== null) return (mediaTime - shown) * 1000;
    return wallMs + TRANSIT_MS - this.#clock.at(now);
  }
}
