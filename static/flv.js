// Watching over HTTP-FLV by mpegts.js, which is loaded when it is first needed.

import { Unreachable } from "./api.js";

const SCRIPT = new URL("vendor/mpegts.js", import.meta.url).href;
const LOOK_MS = 40; // how often is looked for more to play; mpegts.js does not tell
const OPTIONS = {
  enableWorker: false,
  enableStashBuffer: false, // play what there is
  lazyLoad: false,
  autoCleanupSourceBuffer: true,
};

let loading = null; // promise of mpegts

function load() {
  loading ??= new Promise((resolve, reject) => {
    const script = Object.assign(document.createElement("script"), { src: SCRIPT });
    script.onload = () => resolve(globalThis.mpegts);
    script.onerror = () => {
      loading = null;
      reject(new Unreachable());
    };
    document.head.append(script);
  });
  return loading;
}

/** The interface of MsePlayback. The times of the video begin at zero, wherever the stream is. */
export class FlvPlayback {
  #video;
  #player = null;
  #closed = false;
  #lookTimer = 0;

  /** Called when the stream breaks off, with the error. */
  onBroken = () => {};
  /** Called whenever more can be played. */
  onMore = () => {};

  /** Whether everything has arrived. */
  complete = false;

  /** mpegts.js lets its times begin at zero. */
  static onStreamClock = false;

  /** Whether this service and this browser can. */
  static async available() {
    if (!globalThis.MediaSource?.isTypeSupported('video/mp4; codecs="avc1.42E01F,mp4a.40.2"')) return false;
    return fetch(SCRIPT, { method: "HEAD" }).then(({ ok }) => ok, () => false);
  }

  constructor(video) {
    this.#video = video;
  }

  /** Seconds that can be played from here without waiting. */
  get ahead() {
    const { buffered, currentTime } = this.#video;
    return buffered.length ? buffered.end(buffered.length - 1) - Math.max(currentTime, buffered.start(0)) : 0;
  }

  /** Opens the stream at `url`; what goes wrong from then on is told by `onBroken`. Raises Unreachable without mpegts.js. */
  async open(url) {
    const mpegts = await load();
    if (this.#closed) return;
    mpegts.LoggingControl.enableAll = false;
    this.#player = mpegts.createPlayer({ type: "flv", isLive: true, url }, OPTIONS);
    const { ERROR, LOADING_COMPLETE } = mpegts.Events;
    this.#player.on(ERROR, (kind, detail, { msg } = {}) => this.onBroken(new Error(msg || `${kind}: ${detail}`)));
    this.#player.on(LOADING_COMPLETE, () => {
      this.complete = true;
    });
    this.#player.attachMediaElement(this.#video);
    this.#player.load();
    this.#lookTimer = setInterval(() => this.onMore(), LOOK_MS);
  }

  close() {
    this.#closed = true;
    clearInterval(this.#lookTimer);
    this.#player?.destroy();
    this.#player = null;
  }
}
