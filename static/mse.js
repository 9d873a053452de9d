// Watching over HTTP: a fragmented MP4, played while it is still being written.

import { request } from "./api.js";
import { headLength, mimeType } from "./codecs.js";
import { openSource } from "./source.js";

const BEHIND_SECONDS = 30; // what has been seen is thrown away after this

function joined(a, b) {
  const both = new Uint8Array(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}

export class MsePlayback {
  #video;
  #abort = new AbortController();
  #source = null;

  /** Called when the stream breaks off, with the error. */
  onBroken = () => {};
  /** Called whenever more can be played. */
  onMore = () => {};

  constructor(video) {
    this.#video = video;
  }

  /** Whether everything has arrived. */
  complete = false;

  /** The times of the video are those of the stream's clock. */
  static onStreamClock = true;

  /** Seconds that can be played from here without waiting. */
  get ahead() {
    const { buffered, currentTime } = this.#video;
    return buffered.length ? buffered.end(buffered.length - 1) - Math.max(currentTime, buffered.start(0)) : 0;
  }

  /** Opens the stream at `url`. Resolves when the head has arrived; the rest follows. Raises Problem, Unreachable, Error. */
  async open(url) {
    const answer = await request(url, { signal: this.#abort.signal });
    const reader = answer.body.getReader();
    let bytes = new Uint8Array(0);
    while (headLength(bytes) === 0) {
      const { done, value } = await reader.read();
      if (done) throw new Error("The stream ended before it began.");
      bytes = joined(bytes, value);
    }
    this.#source = await openSource(this.#video, mimeType(bytes));
    await this.#source.append(bytes);
    this.#pump(reader).catch((error) => {
      if (!this.#abort.signal.aborted) this.onBroken(error);
    });
  }

  close() {
    this.#abort.abort();
    this.#source?.release();
    this.#source = null;
  }

  async #pump(reader) {
    const source = this.#source;
    this.#arrived();
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      await source.append(value);
      this.#arrived();
      const oldest = this.#video.currentTime - BEHIND_SECONDS;
      if (oldest > source.start + BEHIND_SECONDS) await source.remove(0, oldest);
    }
    await source.end();
    this.complete = true;
    this.onMore();
  }

  #arrived() {
    const { buffered } = this.#video;
    // Whoever joins late begins where the stream is, not at zero.
    if (buffered.length && this.#video.currentTime < buffered.start(0)) this.#video.currentTime = buffered.start(0);
    this.onMore();
  }
}
