// A stream that somebody else has made, over HTTP. One fragmented MP4 is kept open, for who watches nothing is nobody to
// the service; it is opened anew after every utterance, so that what lies between two of them need not be kept.

import { StreamEvents } from "./events.js";
import { HeldMp4 } from "./held_mp4.js";
import { streamEnded } from "./streams.js";

export class JoinedHttpTransport {
  name = "mp4";
  #api;
  #streams;
  #seam;
  #mp4;
  #session = null; // promise of {stream, events}
  #continuous = false;

  onEvent = () => {};
  onLost = () => {};

  constructor({ api, streams, ...parts }) {
    this.#api = api;
    this.#streams = streams;
    this.#seam = parts.seam;
    this.#mp4 = new HeldMp4(parts);
    this.#mp4.onBroken = (error) => this.#lose(error);
  }

  get lead() {
    return this.#mp4.lead;
  }

  /** Connects. Does nothing when connected. */
  prepare() {
    if (!this.#session) {
      const session = this.#open();
      this.#session = session;
      session.then(
        ({ stream }) => this.#session === session && this.#begin(stream),
        () => {
          if (this.#session === session) this.#session = null;
        },
      );
    }
    return this.#session;
  }

  /** Has `words` said; returns `{stream, utterance}`. See RtcTransport. */
  async say(avatar, words, { interrupt, phase, wanted }) {
    const { stream } = await this.prepare();
    if (!wanted()) throw new DOMException("not wanted any more", "AbortError");
    return { stream, utterance: await this.#api.say(stream, { ...words, interrupt, phase: phase() }) };
  }

  /** speak_started has come. */
  starting(event) {
    if (this.#continuous && this.#seam.showing) this.#seam.expect();
    else this.#mp4.show({ from: event.media_time });
  }

  /** What was being said is over, and seen to its end. */
  async finished() {
    const session = await this.#session?.catch(() => null);
    if (session && !this.#continuous) this.#watch(session.stream);
  }

  measured(ahead) {
    this.#mp4.measured(ahead);
  }

  /** Cuts short what is being said. */
  async stop() {
    const session = await this.#session;
    if (session) await this.#api.interrupt(session.stream);
  }

  close() {
    const session = this.#session;
    this.#session = null;
    this.#seam.stay(false);
    this.#mp4.drop();
    session?.then(({ events }) => events.close(), () => {});
  }

  async #open() {
    const stream = await this.#streams.open();
    this.#continuous = stream.continuous;
    const onEvent = (name, data) => {
      if (name === "state" && data.state === "ended") this.#lose(streamEnded());
      else this.onEvent(name, data);
    };
    const onGone = () => this.#lose(streamEnded());
    const events = new StreamEvents(stream.urls.events, onEvent, onGone);
    return { stream, events };
  }

  #begin(stream) {
    this.#watch(stream);
    if (!stream.continuous) return;
    this.#seam.stay(true);
    this.#mp4.show();
  }

  #watch(stream) {
    this.#mp4.open(stream.urls.mp4);
  }

  #lose(error) {
    if (!this.#session) return;
    this.close();
    this.onLost(error);
  }
}
