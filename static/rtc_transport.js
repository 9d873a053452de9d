// Speaking over WebRTC: one stream and one connection, kept for many utterances.

import { StreamEvents } from "./events.js";
import { Lead } from "./lead.js";
import { streamEnded } from "./streams.js";
import { WebRtcFailed, WhepViewer } from "./whep.js";

const MAX_LEAD_MS = 300;
const ENDED = [404, 410]; // the stream is not there any more

export class RtcTransport {
  name = "webrtc";
  #api;
  #streams;
  #seam;
  #idle;
  #video;
  #sound;
  #lead = new Lead(0, -MAX_LEAD_MS, MAX_LEAD_MS);
  #session = null; // promise of {stream, viewer, events}
  #iceServers = [];

  /** Called with (name, data) for every event of the service. */
  onEvent = () => {};
  /** Called with an Error when the connection dies. */
  onLost = () => {};

  constructor({ api, streams, seam, idle, video, sound }) {
    this.#api = api;
    this.#streams = streams;
    this.#seam = seam;
    this.#idle = idle;
    this.#video = video;
    this.#sound = sound;
  }

  /** Milliseconds by which the live background must run ahead to arrive in step with the idle clip. */
  get lead() {
    return this.#lead.milliseconds;
  }

  /** Connects, so that the first utterance need not wait for it. Does nothing when connected. */
  prepare(avatar) {
    if (!this.#session) {
      const session = this.#open(avatar);
      this.#session = session;
      session.then(
        ({ stream }) => {
          if (this.#session !== session || !stream.continuous) return;
          this.#seam.stay(true);
          this.#seam.expect();
        },
        () => {
          if (this.#session === session) this.#session = null;
        },
      );
    }
    return this.#session;
  }

  /**
   * Has `words` said; returns `{stream, utterance}`. A stream that has ended meanwhile is replaced.
   * interrupt: instead of what is being said; false: after it, which shows itself by `starting`. phase(): where the idle
   * clip is; wanted(): false when the user has changed his mind, which raises AbortError before anything is said.
   */
  async say(avatar, words, { interrupt, phase, wanted }) {
    for (let attempt = 0; ; attempt += 1) {
      const session = await this.prepare(avatar);
      if (!wanted()) throw new DOMException("not wanted any more", "AbortError");
      this.#sound.play();
      if (interrupt) this.#seam.expect();
      try {
        const utterance = await this.#api.say(session.stream, { ...words, interrupt, phase: phase() });
        return { stream: session.stream, utterance };
      } catch (error) {
        if (!ENDED.includes(error.status) || attempt > 0) throw error;
        this.close({ ended: true });
      }
    }
  }

  /** speak_started has come; `asked`: for what was said here, which is expected already. */
  starting(event, { asked }) {
    if (!asked) this.#seam.expect();
  }

  finished() {}

  /** The live picture turned out to be `ahead` frames ahead of the idle clip. */
  measured(ahead) {
    this.#lead.learn((-ahead * 1000) / this.#idle.fps);
  }

  /** Cuts short what is being said. */
  async stop() {
    const session = await this.#session;
    if (session) await this.#api.interrupt(session.stream);
  }

  /** Gives the stream back; `ended`: it has ended already. */
  close({ ended = false } = {}) {
    const session = this.#session;
    this.#session = null;
    this.#seam.stay(false);
    session?.then(
      ({ stream, viewer, events }) => {
        events.close();
        viewer.close({ leave: !ended && !this.#streams.own });
        if (!ended) this.#streams.end(stream);
        if (this.#session === null && this.#video.srcObject === viewer.media) this.#video.srcObject = null;
      },
      () => {},
    );
  }

  async #open(avatar) {
    if (!globalThis.RTCPeerConnection) throw new WebRtcFailed("This browser has no WebRTC.");
    const stream = await this.#streams.open(avatar);
    let lost = false;
    const lose = (error, ended) => {
      if (lost) return;
      lost = true;
      this.close({ ended });
      this.onLost(error);
    };
    const onEvent = (name, data) => {
      if (name === "state" && data.state === "ended") lose(streamEnded(), true);
      else this.onEvent(name, data);
    };
    const events = new StreamEvents(stream.urls.events, onEvent, () => lose(streamEnded(), true));
    try {
      const viewer = await this.#connect(stream.urls.whep, () => lose(new WebRtcFailed("The WebRTC connection was lost."), false));
      this.#video.removeAttribute("src");
      this.#video.srcObject = viewer.media;
      this.#seam.sourceChanged();
      this.#sound.play();
      return { stream, viewer, events };
    } catch (error) {
      events.close();
      this.#streams.end(stream);
      throw error;
    }
  }

  async #connect(url, onLost) {
    for (let attempt = 0; ; attempt += 1) {
      const viewer = new WhepViewer(this.#iceServers, onLost);
      try {
        await viewer.connect(url);
        return viewer;
      } catch (error) {
        // The service names its STUN and TURN servers only in its answer; with them the second try may succeed.
        if (attempt > 0 || !error.iceServers?.length || this.#iceServers.length) throw error;
        this.#iceServers = error.iceServers;
      }
    }
  }
}
