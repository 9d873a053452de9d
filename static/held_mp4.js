// A fragmented MP4 on the live video, held until enough of it is there, and shown when the idle clip has come to the
// place in the loop at which it begins.

import { Lead } from "./lead.js";
import { MsePlayback } from "./mse.js";
import { difference } from "./phase.js";

const START_SECONDS = 0.15; // what must have arrived before the picture moves, so that it does not stop again
const MAX_WAIT_FRAMES = 6; // longest wait for the idle clip to reach the first live frame
const WANTED_WAIT_FRAMES = 2; // it comes up to a frame and a half earlier or later than expected
const MAX_LEAD_MS = 1500;
const MAX_START_MS = 250;
const PATIENCE_MS = 15_000; // playback is behind the service, and further behind after every stall
const BEHIND_SECONDS = 3; // further behind the service than this is caught up with by a jump
const CLOSE_BEHIND_SECONDS = 0.5;

export class HeldMp4 {
  #seam;
  #idle;
  #video;
  #sound;
  #Playback;
  #current = null; // {playback, held: to be shown, ready: first frame decoded, starting, from: media time or null}
  #startTimer = 0;
  #lead = new Lead(250, 0, MAX_LEAD_MS);
  #moving = new Lead(80, 0, MAX_START_MS); // from telling the video to play to its moving

  /** Called with an error when the connection breaks off. */
  onBroken = () => {};

  /** Playback: what brings it, MsePlayback or another of its kind. */
  constructor({ seam, idle, video, sound, Playback = MsePlayback }) {
    this.#Playback = Playback;
    this.#seam = seam;
    this.#idle = idle;
    this.#video = video;
    this.#sound = sound;
    video.addEventListener("ended", () => this.#current && this.#seam.cut());
    video.addEventListener("canplay", () => this.#tryStart());
    video.addEventListener("loadeddata", () => document.hidden && this.#tryStart()); // hidden tabs see no frames
    video.addEventListener("seeked", () => document.hidden && this.#tryStart());
  }

  /** Milliseconds by which the live background must run ahead to arrive in step with the idle clip. */
  get lead() {
    return this.#lead.milliseconds;
  }

  /** Whether everything has arrived. */
  get complete() {
    return this.#current?.playback.complete ?? true;
  }

  /** Loads from `url` once `ready` is resolved. */
  async open(url, ready = null) {
    this.drop();
    const playback = new this.#Playback(this.#video);
    const current = { playback, held: false, ready: false, starting: false, from: null };
    this.#current = current;
    playback.onMore = () => this.#onMore(current);
    playback.onBroken = (error) => this.#current === current && this.onBroken(error);
    this.#video.srcObject = null;
    this.#seam.sourceChanged({ onStreamClock: this.#Playback.onStreamClock });
    try {
      await ready;
      if (this.#current === current) await playback.open(url);
    } catch (error) {
      if (this.#current === current && error.name !== "AbortError") this.onBroken(error);
    }
  }

  /** It is to be seen when it can be: from media time `from` on, if given. */
  show({ from = null } = {}) {
    const current = this.#current;
    if (!current) return;
    Object.assign(current, { held: true, ready: current.ready && from === null, starting: false, from });
    this.#seam.expect({ hold: true, patience: PATIENCE_MS });
    this.#seam.onReady = () => {
      if (current.from !== null) return; // that is not the frame to begin with
      current.ready = true;
      this.#tryStart();
    };
    this.#onMore(current);
  }

  /** The live picture turned out to be `ahead` frames ahead of the idle clip. */
  measured(ahead) {
    if (Math.abs(ahead) < MAX_WAIT_FRAMES) this.#moving.learn((-ahead * 1000) / this.#idle.fps);
  }

  drop() {
    clearTimeout(this.#startTimer);
    if (!this.#current) return;
    this.#current.playback.close();
    this.#current = null;
    this.#video.pause();
    if (this.#seam.showing) this.#seam.cut();
    this.#video.removeAttribute("src");
    this.#video.load();
  }

  #onMore(current) {
    if (current !== this.#current) return;
    if (current.from !== null) this.#seek(current);
    else if (current.starting && !current.playback.complete && current.playback.ahead > BEHIND_SECONDS) {
      this.#video.currentTime += current.playback.ahead - CLOSE_BEHIND_SECONDS;
    }
    this.#tryStart();
  }

  // What was there before the utterance, in a stream joined in its middle, is passed over.
  #seek(current) {
    const { buffered } = this.#video;
    if (!buffered.length || buffered.end(buffered.length - 1) <= current.from) return;
    const target = Math.max(current.from, buffered.start(buffered.length - 1));
    current.from = null;
    if (Math.abs(this.#video.currentTime - target) > 1e-3) this.#video.currentTime = target;
    else current.ready = true;
  }

  #tryStart() {
    const current = this.#current;
    if (!current || !current.held || current.starting || current.from !== null) return;
    if (!current.ready && !document.hidden) return;
    if (current.playback.ahead < START_SECONDS && !current.playback.complete) return;
    // Told to play before that, it would begin whenever the browser thinks it has enough, up to 0.1 s later.
    if (this.#video.readyState < HTMLMediaElement.HAVE_FUTURE_DATA) return;
    current.starting = true;
    this.#startTimer = setTimeout(() => this.#start(current), this.#waitForIdle());
  }

  // The first live frame has a fixed place in the loop; the idle clip is waited for if it is about to get there.
  #waitForIdle() {
    const idle = this.#idle.at(performance.now());
    const live = this.#seam.firstLoopFrame;
    if (idle === null || live === null) return 0;
    const frameMs = 1000 / this.#idle.fps;
    const wait = difference(live, idle, this.#idle.frames) - this.#moving.milliseconds / frameMs;
    this.#lead.learn((WANTED_WAIT_FRAMES - wait) * frameMs);
    return wait > 0 && wait <= MAX_WAIT_FRAMES ? wait * frameMs : 0;
  }

  #start(current) {
    if (this.#current !== current) return;
    this.#sound.play();
    this.#seam.release();
  }
}
