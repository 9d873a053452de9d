// What makes <mary-avatar> move: idle clip, live video, seam, transports and captions, put together for one life of the
// element on a page.

import { Api } from "./api.js";
import { Captions } from "./captions.js";
import { ServerClock } from "./clock.js";
import { Conversation } from "./conversation.js";
import { Cues } from "./cues.js";
import { HttpTransport } from "./http_transport.js";
import { IdleLoop } from "./idle.js";
import { JoinedHttpTransport } from "./joined_http_transport.js";
import { explain, MESSAGES } from "./messages.js";
import { RtcTransport } from "./rtc_transport.js";
import { Seam } from "./seam.js";
import { Sound } from "./sound.js";
import { JoinedStream, locateStream, OwnStreams } from "./streams.js";

const RETRY_MS = 3000;

export class Player {
  #view;
  #tell;
  #api;
  #url = null; // of somebody else's stream
  #idle;
  #seam;
  #sound;
  #captions;
  #cues;
  #conversation;
  #released = false;
  #loaded = false;
  #avatar = null; // the one wanted: an id, "" for the service's default
  #shown = ""; // the one whose idle clip is there
  #retryTimer = 0;

  /**
   * view: an AvatarView; tell(name, detail): called with everything that happens; server: address of the service;
   * stream: id or address of a stream to join, or "".
   */
  constructor(view, tell, { server, stream }) {
    this.#view = view;
    this.#tell = tell;
    if (stream) ({ server, url: this.#url } = locateStream(stream, server));
    const clock = new ServerClock();
    const { live: video } = view;
    this.#api = new Api(clock, server);
    this.#idle = new IdleLoop(view.idle);
    this.#sound = new Sound(video);
    this.#seam = new Seam(view.picture, video, this.#idle, clock);
    this.#captions = new Captions(view.caption);
    this.#cues = new Cues(this.#seam, clock);
    const streams = this.#url ? new JoinedStream(this.#api, this.#url) : new OwnStreams(this.#api);
    const parts = { api: this.#api, streams, seam: this.#seam, idle: this.#idle, video, sound: this.#sound };
    this.#conversation = new Conversation({
      seam: this.#seam,
      idle: this.#idle,
      clock,
      rtc: new RtcTransport(parts),
      http: this.#url ? new JoinedHttpTransport(parts) : new HttpTransport("mp4", parts),
      flv: this.#url ? null : new HttpTransport("flv", parts),
      joined: this.#url !== null,
    });
    this.#listen();
  }

  /** "loading" until the idle clip is there, then that of the conversation. */
  get state() {
    const { state } = this.#conversation;
    return state === "idle" && !this.#loaded ? "loading" : state;
  }

  /** avatar: id, or "" for the service's default; transport: "auto", "webrtc", "mp4" or "flv". */
  choose({ avatar, transport }) {
    this.#conversation.choose({ avatar: avatar || undefined, transport });
    if (avatar !== this.#avatar) {
      this.#avatar = avatar;
      this.#load();
    }
    if (this.#url) this.#conversation.prepare();
  }

  sound({ volume, muted }) {
    this.#sound.set({ volume, muted });
  }

  captions(enabled) {
    this.#captions.enabled = enabled;
  }

  prepare() {
    return this.#conversation.prepare();
  }

  say(words, options) {
    return this.#conversation.say(words, options);
  }

  stop() {
    this.#quiet();
    return this.#conversation.stop();
  }

  /** Gives back everything held at the service. */
  close() {
    this.#conversation.close();
  }

  /** The end: nothing is left running. */
  release() {
    this.#released = true;
    clearTimeout(this.#retryTimer);
    this.#conversation.release();
    this.#cues.drop();
    this.#seam.close();
    this.#idle.release();
  }

  async #load() {
    clearTimeout(this.#retryTimer);
    const wanted = this.#avatar;
    try {
      const { avatars, default: fallback } = await this.#api.avatars();
      const id = this.#url ? (await this.#api.stream(this.#url)).avatar : wanted || fallback;
      const avatar = avatars.find((one) => one.id === id);
      if (!avatar) throw new Error(`The service has no avatar “${id}”.`);
      if (this.#released || wanted !== this.#avatar || id === this.#shown) return;
      this.#view.name(avatar.title);
      this.#view.shape(avatar.width, avatar.height);
      this.#view.idle.poster = avatar.preview;
      await this.#idle.load(avatar.idle, avatar.fps);
      if (this.#released || wanted !== this.#avatar) return;
      const first = !this.#loaded;
      this.#loaded = true;
      this.#shown = id;
      this.#tell("loaded", { avatar: id, title: avatar.title });
      if (first && this.state === "idle") this.#tell("state", { state: "idle" });
    } catch (error) {
      if (this.#released || wanted !== this.#avatar) return;
      this.#tell("problem", { text: `${explain(error)} ${MESSAGES.retrying}` });
      this.#retryTimer = setTimeout(() => this.#load(), RETRY_MS);
    }
  }

  #quiet() {
    this.#cues.drop();
    this.#captions.clear();
  }

  #listen() {
    const on = (name, listener) => this.#conversation.addEventListener(name, ({ detail }) => listener(detail));
    this.#sound.onBlocked = (blocked) => {
      this.#view.unblock.hidden = !blocked;
    };
    this.#view.unblock.addEventListener("click", () => this.#sound.unblock());
    this.#cues.onHeard = (name, data) => {
      if (name === "word") this.#captions.add(data.text);
      this.#tell(name, data);
    };
    on("cue", ({ name, data }) => this.#cues.add(name, data));
    on("cut", ({ mediaTime }) => this.#cues.drop(mediaTime));
    on("state", ({ state }) => {
      if (state === "preparing") this.#captions.clear();
      this.#tell("state", { state: this.state });
    });
    on("accepted", ({ words, utterance: { id, unread } }) => this.#tell("accepted", { ...words, utterance: id, unread }));
    on("shown", ({ stream, utterance, started, milliseconds, transport }) => {
      this.#tell("speak_started", started ?? { utterance: utterance.id });
      this.#tell("shown", { utterance: utterance.id, milliseconds, transport });
      if (stream) this.#api.shown(stream, utterance.id, milliseconds).catch(() => {}); // a figure for the operator
    });
    on("seam", ({ frames }) => this.#tell("seam", { frames }));
    on("finished", ({ utterance, stream, shown, ended }) => {
      this.#captions.clear();
      if (!shown || !utterance) return;
      const self = stream?.urls.self ?? this.#url;
      this.#tell("speak_ended", { ...ended, video: `${self}/video.mp4?utterance=${encodeURIComponent(utterance.id)}` });
    });
    on("notice", (detail) => this.#tell("notice", detail));
    on("problem", (detail) => this.#tell("problem", detail));
  }
}
