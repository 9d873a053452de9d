// Speaking over HTTP: every utterance is a stream of its own, played as a fragmented MP4.

import { StreamEvents } from "./events.js";
import { MsePlayback } from "./mse.js";
import { difference } from "./phase.js";

const EVENTS_MS = 150; // longest wait for the events
const START_SECONDS = 0.15; // what must have arrived before the picture moves, so that it does not stop again
const MAX_WAIT_FRAMES = 6; // longest wait for the idle clip to reach the first live frame
const WANTED_WAIT_FRAMES = 1;
const MAX_LEAD_MS = 1500;
const MAX_START_MS = 250;
const LEARNING = 0.7;
const PATIENCE_MS = 15_000; // playback is behind the service, and further behind after every stall

export class HttpTransport {
  name = "mp4";
  lead = 250; // ms; learned from every utterance
  #api;
  #seam;
  #idle;
  #video;
  #sound;
  #current = null; // {stream, events, playback, ready: first frame decoded, starting}
  #startTimer = 0;
  #startMs = 80; // from telling the video to play to its moving; learned, too

  onEvent = () => {};
  onLost = () => {};

  constructor({ api, seam, idle, video, sound }) {
    this.#api = api;
    this.#seam = seam;
    this.#idle = idle;
    this.#video = video;
    this.#sound = sound;
    video.addEventListener("ended", () => this.#current && this.#seam.cut());
    video.addEventListener("loadeddata", () => document.hidden && this.#tryStart()); // hidden tabs see no frames
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
    const playback = new MsePlayback(this.#video);
    const events = new StreamEvents(stream.urls.events, (name, data) => this.#pass(name, data), () => {});
    const current = { stream, events, playback, ready: false, starting: false };
    this.#current = current;
    playback.onMore = () => this.#tryStart();
    playback.onBroken = (error) => this.#current === current && this.onLost(error);
    this.#video.srcObject = null;
    this.#seam.sourceChanged();
    this.#seam.expect({ hold: true, patience: PATIENCE_MS });
    this.#seam.onReady = () => {
      current.ready = true;
      this.#tryStart();
    };
    this.#open(current);
    return { stream, utterance: stream.utterance };
  }

  /** The live picture turned out to be `ahead` frames ahead of the idle clip. */
  measured(ahead) {
    const late = (-ahead * LEARNING * 1000) / this.#idle.fps;
    if (Math.abs(ahead) < MAX_WAIT_FRAMES) this.#startMs = Math.max(0, Math.min(MAX_START_MS, this.#startMs + late));
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
    const current = this.#current;
    this.#drop();
    if (current && !current.playback.complete) this.#api.end(current.stream);
  }

  #pass(name, data) {
    if (name === "speak_ended") this.#current?.events.close(); // nothing follows; do not ask an ended stream again
    this.onEvent(name, data);
  }

  async #open(current) {
    try {
      await current.events.opened(EVENTS_MS); // with the first viewer speech begins, and that must be heard of
      if (this.#current === current) await current.playback.open(current.stream.urls.mp4);
    } catch (error) {
      if (this.#current === current && error.name !== "AbortError") this.onLost(error);
    }
  }

  #drop() {
    clearTimeout(this.#startTimer);
    if (!this.#current) return;
    this.#current.events.close();
    this.#current.playback.close();
    this.#current = null;
    this.#video.pause();
    if (this.#seam.showing) this.#seam.cut();
    this.#video.removeAttribute("src");
    this.#video.load();
  }

  #tryStart() {
    const current = this.#current;
    if (!current || current.starting) return;
    if (!current.ready && !document.hidden) return;
    if (current.playback.ahead < START_SECONDS && !current.playback.complete) return;
    current.starting = true;
    this.#startTimer = setTimeout(() => this.#start(current), this.#waitForIdle());
  }

  // The first live frame has a fixed place in the loop; the idle clip is waited for if it is about to get there.
  #waitForIdle() {
    const idle = this.#idle.at(performance.now());
    const live = this.#seam.firstLoopFrame;
    if (idle === null || live === null) return 0;
    const frameMs = 1000 / this.#idle.fps;
    const wait = difference(live, idle, this.#idle.frames) - this.#startMs / frameMs;
    const lead = this.lead - (wait - WANTED_WAIT_FRAMES) * LEARNING * frameMs;
    this.lead = Math.max(0, Math.min(MAX_LEAD_MS, lead));
    return wait > 0 && wait <= MAX_WAIT_FRAMES ? wait * frameMs : 0;
  }

  #start(current) {
    if (this.#current !== current) return;
    this.#sound.play();
    this.#seam.release();
  }
}
