// What the user wants said, and what becomes of it: one utterance at a time, over the transport that works.

import { explain, MESSAGES } from "./messages.js";
import { WebRtcFailed } from "./whep.js";

const UNUSED_MS = 180_000; // a connection nobody uses is given back
const NO_PICTURE_MS = 3000; // speech has begun, but nothing is seen
const STOPPING_MS = 1500;

export class Conversation extends EventTarget {
  #seam;
  #idle;
  #clock;
  #rtc;
  #http;
  #choice = "auto";
  #avatar;
  #rtcFailed = false;
  #toldFallBack = false;
  #turn = 0; // counts what the user asked for; answers to older wishes are dropped
  #current = null;
  #over = new Map(); // utterances that have ended, and whether anything of them was to be heard
  #failed = new Map(); // what the service said about those that failed
  #state = "idle";
  #timers = {};

  constructor({ seam, idle, clock, rtc, http }) {
    super();
    this.#seam = seam;
    this.#idle = idle;
    this.#clock = clock;
    this.#rtc = rtc;
    this.#http = http;
    for (const transport of [rtc, http]) {
      transport.onEvent = (name, data) => this.#onEvent(name, data);
      transport.onLost = (error) => this.#onLost(transport, error);
    }
    seam.onShown = (time) => this.#onShown(time);
    seam.onReturned = () => this.#onReturned();
    seam.onMeasured = (ahead) => this.#onMeasured(ahead);
  }

  /** "idle", "preparing" or "speaking". */
  get state() {
    return this.#state;
  }

  get #transport() {
    return this.#choice === "mp4" || (this.#choice === "auto" && this.#rtcFailed) ? this.#http : this.#rtc;
  }

  /** choice: "auto", "webrtc" or "mp4"; ends what is being said. */
  choose({ transport, avatar }) {
    if (transport === this.#choice && avatar === this.#avatar) return;
    this.#choice = transport;
    this.#avatar = avatar;
    this.#rtcFailed = false;
    this.close();
  }

  /** The user seems to be about to speak: connect. Failures show when it comes to speaking. */
  async prepare() {
    this.#keep();
    const transport = this.#transport;
    try {
      await transport.prepare(this.#avatar);
    } catch (error) {
      if (transport === this.#rtc && error instanceof WebRtcFailed) this.#fallBack();
    }
  }

  /**
   * Has the text said, at once, also in the middle of something else.
   * enteredAt: page time of the key press; words: {text, voice?, speed}.
   */
  async say(words, enteredAt) {
    this.#turn += 1;
    const turn = this.#turn;
    this.#current = { words, enteredAt, turn, utterance: null, stream: null, shown: false };
    this.#keep();
    this.#setState("preparing");
    const current = this.#current;
    try {
      let answer;
      try {
        answer = await this.#sayBy(this.#transport, words);
      } catch (error) {
        if (!(error instanceof WebRtcFailed) || !this.#fallBack()) throw error;
        if (turn !== this.#turn) return;
        answer = await this.#sayBy(this.#http, words);
      }
      Object.assign(current, answer);
      if (turn !== this.#turn) {
        if (this.#state === "idle") current.transport.stop().catch(() => {}); // stopped before it was accepted
        return;
      }
      this.#tell("accepted", { words, ...answer });
      this.#checkFailed();
      if (current.shown) this.#reportShown(current);
      else this.#checkOver();
    } catch (error) {
      if (turn === this.#turn) this.#fail(explain(error));
    }
  }

  /** Cuts short what is being said. */
  async stop() {
    if (this.#state === "idle") return;
    const { transport, utterance } = this.#current;
    this.#turn += 1;
    const turn = this.#turn;
    const stopping = transport.stop();
    const unseen = !utterance || !this.#seam.showing;
    if (unseen) this.#finish(); // there is no picture to wait for
    try {
      await stopping;
      if (!unseen) this.#timer("stopping", STOPPING_MS, () => turn === this.#turn && this.#finish());
    } catch (error) {
      if (turn !== this.#turn) return; // something else is being said by now
      if (!unseen) this.#fail(explain(error));
      else if (utterance) this.#tell("problem", { text: explain(error) }); // else only the connection has failed
    }
  }

  /** Gives back everything held at the service. */
  close() {
    this.#turn += 1;
    this.#rtc.close();
    this.#http.close();
    this.#finish();
  }

  #sayBy(transport, words) {
    if (this.#rtcFailed && !this.#toldFallBack) this.#tell("notice", { text: MESSAGES.fellBack });
    this.#toldFallBack = this.#rtcFailed;
    this.#current.transport = transport;
    const { turn } = this.#current;
    const options = { phase: () => this.#phase(transport.lead), wanted: () => turn === this.#turn };
    return transport.say(this.#avatar, words, options);
  }

  #phase(lead) {
    const now = performance.now();
    const frame = this.#idle.at(now);
    return frame === null ? undefined : { frame, at_ms: this.#clock.at(now) - lead };
  }

  #onEvent(name, data) {
    if (name === "speak_started") {
      this.#seam.started(data);
      if (this.#current && !this.#current.shown && this.#current.transport === this.#rtc) {
        this.#timer("noPicture", NO_PICTURE_MS, () => this.#onNoPicture());
      }
    } else if (name === "speak_ended") {
      const heard = data.media_time !== null; // otherwise it ended before its first sound
      this.#over.set(data.utterance, heard);
      const takenCareOf = heard && this.#seam.ended(data);
      if (!takenCareOf && !this.#seam.showing && this.#current?.utterance?.id === data.utterance) this.#finish();
    } else if (name === "error") {
      const utterance = data.utterance ?? this.#current?.utterance?.id; // none is named when the whole stream fails
      if (utterance !== undefined) this.#failed.set(utterance, data.message);
      this.#checkFailed();
    }
  }

  // The service may tell of the end before it has answered the request; a picture to come or to go is waited for.
  #checkOver() {
    const heard = this.#over.get(this.#current?.utterance?.id);
    if (heard === undefined || this.#seam.showing || (heard && this.#seam.expecting)) return;
    this.#finish();
  }

  // The service tells of a failure by events, possibly before it has answered the request.
  #checkFailed() {
    const message = this.#failed.get(this.#current?.utterance?.id);
    if (message === undefined) return;
    if (this.#seam.showing) this.#tell("problem", { text: message }); // what can be said is said to its end
    else this.#fail(message);
  }

  #onNoPicture() {
    if (!this.#current || this.#current.shown || document.hidden) return;
    this.#onLost(this.#rtc, new WebRtcFailed("Mary speaks, but no picture arrives by WebRTC."));
  }

  async #onLost(transport, error) {
    const current = this.#current;
    const speaking = this.#state !== "idle" && current?.transport === transport;
    if (!speaking) return; // the next utterance connects anew
    transport.close();
    if (transport === this.#rtc && error instanceof WebRtcFailed && !current.shown && this.#fallBack()) {
      this.#finish();
      await this.say(current.words, current.enteredAt);
    } else {
      this.#fail(`${explain(error)} ${MESSAGES.lost}`);
    }
  }

  // True if there is another transport to go to.
  #fallBack() {
    if (this.#choice !== "auto") return false;
    this.#rtcFailed = true;
    this.#rtc.close();
    return true;
  }

  #onShown(time) {
    const current = this.#current;
    if (!current || current.shown) return;
    current.shown = true;
    current.shownMs = Math.max(0, time - current.enteredAt);
    clearTimeout(this.#timers.noPicture);
    this.#setState("speaking");
    if (current.utterance) this.#reportShown(current);
  }

  #reportShown({ stream, utterance, shownMs, transport }) {
    this.#tell("shown", { stream, utterance, milliseconds: shownMs, transport: transport.name });
  }

  #onMeasured(ahead) {
    this.#current?.transport?.measured(ahead);
    this.#tell("seam", { frames: ahead });
  }

  #onReturned() {
    const current = this.#current;
    if (!current || current.shown || this.#over.has(current.utterance?.id) || current.turn !== this.#turn) this.#finish();
  }

  #finish() {
    clearTimeout(this.#timers.stopping);
    clearTimeout(this.#timers.noPicture);
    this.#seam.abandon();
    if (this.#state === "idle") return;
    const current = this.#current;
    this.#current = null;
    this.#setState("idle");
    this.#keep();
    const completed = Boolean(current?.shown) && current.turn === this.#turn;
    this.#tell("finished", { ...(current?.shown && current), completed });
  }

  #fail(text) {
    this.#finish();
    this.#tell("problem", { text });
  }

  // Starts the time after which an unused connection is given back anew.
  #keep() {
    this.#timer("unused", UNUSED_MS, () => {
      if (this.#state === "idle") this.close();
      else this.#keep();
    });
  }

  #timer(name, delay, action) {
    clearTimeout(this.#timers[name]);
    this.#timers[name] = setTimeout(action, delay);
  }

  #setState(state) {
    if (this.#state === state) return;
    this.#state = state;
    this.#tell("state", { state });
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
