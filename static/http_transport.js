// Speaking over HTTP: every utterance is a stream of its own, played as a fragmented MP4, which arrives as it is or as FLV.

import { StreamEvents } from "./events.js";
import { FlvPlayback } from "./flv.js";
import { HeldMp4 } from "./held_mp4.js";
import { MsePlayback } from "./mse.js";

const EVENTS_MS = 150; // longest wait for the events
const PLAYBACKS = { mp4: MsePlayback, flv: FlvPlayback };

export class HttpTransport {
  #api;
  #seam;
  #held;
  #current = null; // {stream, events}

  onEvent = () => {};
  onLost = () => {};

  /** format: "mp4" or "flv". */
  constructor(format, { api, ...parts }) {
    this.name = format;
    this.#api = api;
    this.#seam = parts.seam;
    this.#held = new HeldMp4({ ...parts, Playback: PLAYBACKS[format] });
    this.#held.onBroken = (error) => this.onLost(error);
  }

  get lead() {
    return this.#held.lead;
  }

  /** Nothing to prepare. */
  async prepare() {}

  /** Has `words` said; returns `{stream, utterance}`. phase, wanted: see RtcTransport. */
  async say(avatar, words, { phase, wanted }) {
    this.#drop();
    const options = { ...words, avatar, once: true, start: "viewer", idle: "local", phase: phase() };
    const stream = await this.#api.createStream(options);
    if (!wanted()) {
      this.#api.end(stream);
      throw new DOMException("not wanted any more", "AbortError");
    }
    const events = new StreamEvents(stream.urls.events, (name, data) => this.#pass(name, data), () => {});
    this.#current = { stream, events };
    this.#held.open(stream.urls[this.name], events.opened(EVENTS_MS)); // with the first viewer speech begins, and that must be heard of
    this.#held.show();
    return { stream, utterance: stream.utterance };
  }

  starting() {}

  finished() {}

  measured(ahead) {
    this.#held.measured(ahead);
  }

  /** Cuts short what is being said. */
  async stop() {
    const current = this.#current;
    this.#drop();
    this.#seam.abandon();
    if (current) await this.#api.interrupt(current.stream).catch((error) => {
      if (error.status !== 410) throw error; // it had just ended
    });
  }

  close() {
    const complete = this.#held.complete;
    const current = this.#current;
    this.#drop();
    if (current && !complete) this.#api.end(current.stream);
  }

  #pass(name, data) {
    if (name === "speak_ended") this.#current?.events.close(); // nothing follows; do not ask an ended stream again
    this.onEvent(name, data);
  }

  #drop() {
    this.#current?.events.close();
    this.#current = null;
    this.#held.drop();
  }
}
