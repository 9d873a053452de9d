// Speaking over HTTP: every utterance is a stream of its own, played as a fragmented MP4.

import { StreamEvents } from "./events.js";
import { HeldMp4 } from "./held_mp4.js";

const EVENTS_MS = 150; // longest wait for the events

export class HttpTransport {
  name = "mp4";
  #api;
  #seam;
  #mp4;
  #current = null; // {stream, events}

  onEvent = () => {};
  onLost = () => {};

  constructor({ api, ...parts }) {
    this.#api = api;
    this.#seam = parts.seam;
    this.#mp4 = new HeldMp4(parts);
    this.#mp4.onBroken = (error) => this.onLost(error);
  }

  get lead() {
    return this.#mp4.lead;
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
    this.#mp4.open(stream.urls.mp4, events.opened(EVENTS_MS)); // with the first viewer speech begins, and that must be heard of
    this.#mp4.show();
    return { stream, utterance: stream.utterance };
  }

  starting() {}

  finished() {}

  measured(ahead) {
    this.#mp4.measured(ahead);
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
    const complete = this.#mp4.complete;
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
    this.#mp4.drop();
  }
}
