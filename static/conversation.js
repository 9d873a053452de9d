// What is to be said, and what becomes of it: one utterance at a time, over the transport that works. On a stream that
// somebody else has made, also what others have said there.

import { explain, MESSAGES } from "./messages.js";
import { WebRtcFailed } from "./whep.js";

const UNUSED_MS = 180_000; // a connection nobody uses is given back
const NO_PICTURE_MS = 3000; // speech has begun, but nothing is seen
const STOPPING_MS = 1500;
const KEPT_UTTERANCES = 50; // whose ends are remembered
const RECONNECT_MS = 3000;
const ENDED = [404, 410]; // the stream is not there any more

function remember(events, data) {
  events.set(data.utterance, data);
  if (events.size > KEPT_UTTERANCES) events.delete(events.keys().next().value);
}

export class Conversation extends EventTarget {
  #seam;
  #idle;
  #clock;
  #rtc;
  #http;
  #flv;
  #choice = "auto";
  #avatar;
  #rtcFailed = false;
  #toldFallBack = false;
  #joined;
  #turn = 0; // counts what the user asked for; answers to older wishes are dropped
  #current = null;
  #waiting = []; // what is to be said after it
  #started = new Map(); // speak_started of the last utterances
  #over = new Map(); // and their speak_ended
  #failed = new Map(); // what the service said about those that failed
  #state = "idle";
  #timers = {};
  #released = false;

  /** joined: the stream is somebody else's. */
  constructor({ seam, idle, clock, rtc, http, flv = null, joined = false }) {
    super();
    this.#joined = joined;
    this.#seam = seam;
    this.#idle = idle;
    this.#clock = clock;
    this.#rtc = rtc;
    this.#http = http;
    this.#flv = flv ?? http;
    for (const transport of new Set([rtc, http, this.#flv])) {
      transport.onEvent = (name, data) => this.#onEvent(name, data);
      transport.onLost = (error) => this.#onLost(transport, error);
    }
    seam.onShown = (time) => this.#onShown(time);
    seam.onReturned = () => this.#onReturned();
    seam.onMeasured = (ahead) => this.#onMeasured(ahead);
  }

  /** "idle", "preparing" or "speaking"; "ended" if the stream, somebody else's, has ended. */
  get state() {
    return this.#state;
  }

  get #transport() {
    if (this.#choice === "flv") return this.#flv;
    return this.#choice === "mp4" || (this.#choice === "auto" && this.#rtcFailed) ? this.#http : this.#rtc;
  }

  /** choice: "auto", "webrtc", "mp4" or "flv" (for streams of others that is "mp4"); ends what is being said. */
  choose({ transport, avatar }) {
    if (transport === this.#choice && avatar === this.#avatar) return;
    this.#choice = transport;
    this.#avatar = avatar;
    this.#rtcFailed = false;
    this.close();
  }

  /** Somebody seems to be about to speak: connect. Failures show when it comes to speaking. */
  async prepare() {
    if (this.#released) return;
    this.#keep();
    const transport = this.#transport;
    try {
      await transport.prepare(this.#avatar);
    } catch (error) {
      if (transport === this.#rtc && error instanceof WebRtcFailed && this.#fallBack()) {
        if (this.#joined) await this.prepare();
      } else if (this.#joined) this.#retry(error);
    }
  }

  /**
   * Has `words` ({text, voice?, speed?}) said; resolves to the utterance when the service has accepted it, to null when
   * it is not said. interrupt: at once, also in the middle of something else; otherwise after what is to be said
   * already. enteredAt: page time at which it was asked for.
   */
  say(words, { interrupt = false, enteredAt = performance.now() } = {}) {
    if (interrupt || this.#state === "idle") {
      this.#forgetWaiting();
      return this.#sayNow(words, enteredAt);
    }
    if (this.#joined) return this.#sayLater(words);
    return new Promise((resolve) => this.#waiting.push({ words, enteredAt, resolve }));
  }

  /** Cuts short what is being said. */
  async stop() {
    this.#forgetWaiting();
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
    this.#forgetWaiting();
    this.#rtc.close();
    this.#http.close();
    this.#flv.close();
    this.#finish();
    for (const timer of Object.values(this.#timers)) clearTimeout(timer);
  }

  /** Closes for good. */
  release() {
    this.#released = true;
    this.close();
  }

  async #sayNow(words, enteredAt) {
    this.#turn += 1;
    const turn = this.#turn;
    this.#tell("cut", { mediaTime: -Infinity });
    const current = { words, enteredAt, turn, utterance: null, stream: null, shown: false };
    this.#current = current;
    this.#keep();
    this.#setState("preparing");
    try {
      let answer;
      try {
        answer = await this.#sayBy(this.#transport, words);
      } catch (error) {
        if (!(error instanceof WebRtcFailed) || !this.#fallBack()) throw error;
        if (turn !== this.#turn) return null;
        answer = await this.#sayBy(this.#http, words);
      }
      Object.assign(current, answer);
      if (turn !== this.#turn) {
        const unwanted = this.#state === "idle" || this.#current.utterance?.id === current.utterance.id;
        if (unwanted) current.transport.stop().catch(() => {}); // stopped before it was accepted
        return null;
      }
      this.#tell("accepted", { words, ...answer });
      this.#checkFailed();
      if (current.shown) this.#reportShown(current);
      else this.#checkOver();
      return current.utterance;
    } catch (error) {
      if (turn === this.#turn) this.#fail(explain(error));
      return null;
    }
  }

  // Queued by the service, after what others have queued there.
  async #sayLater(words) {
    const transport = this.#transport;
    try {
      const options = { interrupt: false, phase: () => undefined, wanted: () => true };
      const answer = await transport.say(this.#avatar, words, options);
      this.#tell("accepted", { words, ...answer });
      return answer.utterance;
    } catch (error) {
      this.#tell("problem", { text: explain(error) });
      return null;
    }
  }

  #sayBy(transport, words) {
    if (this.#rtcFailed && !this.#toldFallBack) this.#tell("notice", { text: MESSAGES.fellBack });
    this.#toldFallBack = this.#rtcFailed;
    this.#current.transport = transport;
    const { turn } = this.#current;
    const options = { interrupt: true, phase: () => this.#phase(transport.lead), wanted: () => turn === this.#turn };
    return transport.say(this.#avatar, words, options);
  }

  #forgetWaiting() {
    for (const { resolve } of this.#waiting.splice(0)) resolve(null);
  }

  #sayNext() {
    const next = this.#waiting.shift();
    if (next) this.#sayNow(next.words, next.enteredAt).then(next.resolve);
  }

  #phase(lead) {
    const now = performance.now();
    const frame = this.#idle.at(now);
    return frame === null ? undefined : { frame, at_ms: this.#clock.at(now) - lead };
  }

  #onEvent(name, data) {
    if (name === "speak_started") this.#onStarted(data);
    else if (name === "speak_ended") this.#onEnded(data);
    else if (["word", "mark", "viseme"].includes(name)) this.#tell("cue", { name, data });
    else if (name === "error") {
      const utterance = data.utterance ?? this.#current?.utterance?.id; // none is named when the whole stream fails
      if (utterance !== undefined) this.#failed.set(utterance, data.message);
      this.#checkFailed();
    }
  }

  #onStarted(data) {
    if (this.#started.has(data.utterance)) return; // told again after a reconnection
    remember(this.#started, data);
    const asked = !this.#isForeign(data.utterance);
    if (!asked && !this.#joined) return; // what was stopped before it was accepted
    if (!asked) this.#follow(data.utterance);
    (this.#current?.transport ?? this.#transport).starting(data, { asked });
    this.#seam.started(data);
    if (this.#current && !this.#current.shown && this.#current.transport === this.#rtc) {
      this.#timer("noPicture", NO_PICTURE_MS, () => this.#onNoPicture());
    }
  }

  // As long as the service has not accepted what is to be said now, that is what it begins to say.
  #isForeign(utterance) {
    return !this.#current || (this.#current.utterance !== null && this.#current.utterance.id !== utterance);
  }

  // Somebody else has something said, or what was queued has its turn.
  #follow(utterance) {
    if (this.#current) this.#tellFinished(this.#current);
    this.#turn += 1;
    const transport = this.#transport;
    this.#current = { turn: this.#turn, utterance: { id: utterance, unread: [] }, shown: false, transport };
    this.#setState("preparing");
  }

  #onEnded(data) {
    const heard = data.media_time !== null; // otherwise it ended before its first sound
    remember(this.#over, data);
    if (heard && data.reason !== "done") this.#tell("cut", { mediaTime: data.media_time });
    const takenCareOf = heard && this.#seam.ended(data);
    if (!takenCareOf && !this.#seam.showing && this.#current?.utterance?.id === data.utterance) this.#finish();
  }

  // The service may tell of the end before it has answered the request; a picture to come or to go is waited for.
  #checkOver() {
    const ended = this.#over.get(this.#current?.utterance?.id);
    if (ended === undefined || this.#seam.showing || (ended.media_time !== null && this.#seam.expecting)) return;
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
    if (!this.#joined && !speaking) return; // the next utterance connects anew
    transport.close();
    const failed = transport === this.#rtc && error instanceof WebRtcFailed;
    if (failed && !current?.shown && this.#fallBack()) {
      this.#finish();
      if (current?.words) await this.#sayNow(current.words, current.enteredAt);
      else if (this.#joined) await this.prepare();
    } else if (this.#joined) {
      this.#finish();
      this.#retry(error);
    } else {
      this.#fail(`${explain(error)} ${MESSAGES.lost}`);
    }
  }

  // A stream of somebody else's cannot be replaced: it is waited for, unless it has ended.
  #retry(error) {
    if (ENDED.includes(error.status)) {
      this.#setState("ended");
      this.#tell("problem", { text: MESSAGES.streamEnded });
      return;
    }
    this.#tell("problem", { text: `${explain(error)} ${MESSAGES.retrying}` });
    this.#timer("reconnect", RECONNECT_MS, () => this.prepare());
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
    current.shownMs = current.words ? Math.max(0, time - current.enteredAt) : null;
    clearTimeout(this.#timers.noPicture);
    this.#setState("speaking");
    if (current.utterance) this.#reportShown(current);
  }

  #reportShown({ stream = null, utterance, shownMs, transport }) {
    const started = this.#started.get(utterance.id) ?? null;
    this.#tell("shown", { stream, utterance, started, milliseconds: shownMs, transport: transport.name });
  }

  #onMeasured(ahead) {
    if (this.#current?.words) this.#current.transport.measured(ahead); // what others say is not in step with the clip here
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
    if (!this.#current) return;
    const current = this.#current;
    this.#current = null;
    this.#setState("idle");
    this.#keep();
    this.#tellFinished(current);
    current.transport?.finished();
    if (!this.#current) this.#sayNext();
  }

  #tellFinished(current) {
    const { utterance, stream = null, shown, turn } = current;
    const reason = this.#over.get(utterance?.id)?.reason ?? "interrupted";
    const ended = this.#over.get(utterance?.id) ?? { utterance: utterance?.id, media_time: null, wall_ms: null, reason };
    this.#tell("finished", { utterance, stream, shown, ended });
  }

  #fail(text) {
    this.#finish();
    this.#tell("problem", { text });
  }

  // Starts the time after which an unused connection is given back anew.
  #keep() {
    if (this.#joined) return;
    this.#timer("unused", UNUSED_MS, () => {
      if (this.#state === "idle") this.close();
      else this.#keep();
    });
  }

  #timer(name, delay, action) {
    clearTimeout(this.#timers[name]);
    if (!this.#released) this.#timers[name] = setTimeout(action, delay);
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
