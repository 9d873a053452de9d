// The seam between the idle clip and the live picture. Both videos lie on top of each other; this decides which one is
// seen, changes over exactly with a new live frame, and keeps the covered idle clip in step with the live background, so
// that the way back shows no jump either.

import { watchFrames } from "./frames.js";
import { difference, PhaseTracker } from "./phase.js";

const SETTLING_FRAMES = 4; // live frames after which the difference between the two loops is measured
const RTP_CLOCK = 90_000; // Hz
const TRANSIT_SECONDS = 0.08; // from leaving the service to being seen
const MISSED_SECONDS = 0.5; // a first frame this late is not the first of its utterance
const LAST_FRAMES = 1.25; // so near its end the last frame is seen
const SHIFT_FRAMES = [-0.5, 1]; // least and most by which the return is moved to where the idle clip is
const CHANGE_MS = 12; // from changing over to its being seen
const MAX_GAP_FRAMES = 1.5; // between two utterances; over a longer one the idle clip is shown
const UNSEEN_MS = 600; // past its end an utterance that was not seen is given up
const MAX_FROZEN_SECONDS = 0.2; // a picture that stands still for longer is not followed by the clock

export class Seam {
  #picture;
  #video;
  #idle;
  #clock;
  #expected = null; // {hold, first}: a new live frame is to be shown
  #showing = false;
  #staying = false; // the live picture goes on between utterances
  #position = null; // seconds on the live picture's own clock, of its last frame
  #seenAt = 0; // page time of that frame
  #rtp = null;
  #lag = null; // seconds by which that clock is ahead of the service's
  #guessed = false; // the lag is only about right
  #lastEnd = -Infinity; // where the last utterance ended on the service's clock
  #started = null; // the service's speak_started
  #startedFor = null; // what was expected when it came
  #ended = null;
  #patience = 0;
  #liveTracker = null;
  #first = 0; // position of the first frame shown
  #unlocated = false; // its place on the service's clock is not known yet
  #framesShown = 0;
  #returnTimer = 0;
  #watchdog = 0;
  #stopWatching;

  /** Called with the page time at which the first live frame of an expected utterance is seen. */
  onShown = () => {};
  /** Called when a held live picture has its first frame ready; the answer is to start it and call `release()`. */
  onReady = () => {};
  /** Called with how many frames the live background was ahead of the idle clip at the change. */
  onMeasured = () => {};
  /** Called when the idle clip is seen again. */
  onReturned = () => {};

  /** picture: the element that holds both videos; its `data-shown` ("idle" or "live") is what the style sheet goes by. */
  constructor(picture, video, idle, clock) {
    this.#picture = picture;
    this.#video = video;
    this.#idle = idle;
    this.#clock = clock;
    this.#picture.dataset.shown = "idle";
    this.#stopWatching = watchFrames(video, (time, metadata) => this.#onFrame(time, metadata));
  }

  /** Nothing is shown any more. */
  close() {
    this.#stopWatching();
    this.#stopTimers();
  }

  /** Whether the live picture is seen. */
  get showing() {
    return this.#showing;
  }

  get expecting() {
    return this.#expected !== null;
  }

  /** Seconds on the service's clock of what is seen at page time `time`, or null while that is not known. */
  mediaTimeAt(time) {
    const media = this.#showing ? this.#mediaTime() : null;
    return media === null ? null : media + Math.min(MAX_FROZEN_SECONDS, (time - this.#seenAt) / 1000);
  }

  /** Loop frame at which the live picture begins, once the service has said so. */
  get firstLoopFrame() {
    return this.#started?.loop_frame ?? null;
  }

  /** The live video got another source: its clock begins anew. onStreamClock: its times are the service's. */
  sourceChanged({ onStreamClock = false } = {}) {
    this.#position = null;
    this.#rtp = null;
    this.#lag = onStreamClock ? 0 : null;
    this.#guessed = false;
    this.#lastEnd = -Infinity;
  }

  /** The live picture, once expected and seen, stays when an utterance ends; false: it goes. */
  stay(staying) {
    if (this.#staying === staying) return;
    this.#staying = staying;
    if (!staying) this.cut();
  }

  /**
   * The next new live frame is to be seen; the last frame of an earlier utterance, still in the element, is not new.
   * hold: do not show it but call `onReady`. patience: ms for which the picture may be late, as playback may after a stall;
   * without, it is in time or not at all.
   */
  expect({ hold = false, patience = 0 } = {}) {
    if (!this.#showing) this.#started = null;
    this.#expected = { hold, first: null };
    this.#patience = patience;
  }

  /** speak_started of the service: `{utterance, media_time, loop_frame}`. */
  started(event) {
    if (event.utterance === this.#started?.utterance) return; // told again after a reconnection
    const gap = this.#showing && this.#ended ? (event.media_time - this.#ended.media_time) * this.#idle.fps : 0;
    this.#started = event;
    this.#startedFor = this.#expected;
    if (gap < MAX_GAP_FRAMES || this.#staying) {
      this.#ended = null;
      this.#stopTimers();
    }
    if (this.#showing && this.#unlocated) this.#locate();
    if (this.#expected && !this.#expected.hold && document.hidden) this.#show(performance.now()); // hidden tabs see no frames
  }

  /**
   * speak_ended of the service: `{utterance, media_time, wall_ms}`; the idle clip comes back after the last frame.
   * Returns whether it was about the utterance being shown or expected here.
   */
  ended(event) {
    if (this.#started?.utterance !== event.utterance) return false;
    this.#ended = event;
    this.#lastEnd = event.media_time;
    const awaited = this.#startedFor;
    const due = Math.max(0, event.wall_ms - this.#clock.at(performance.now()));
    this.#watchdog = setTimeout(() => {
      if (this.#showing) this.cut();
      else if (this.#expected === awaited) {
        this.abandon();
        this.onReturned();
      }
    }, due + UNSEEN_MS + this.#patience);
    this.#planReturn();
    return true;
  }

  /** The held picture is starting: its next new frame is to be seen. */
  release() {
    if (!this.#expected) return;
    this.#expected.hold = false;
    if (document.hidden) this.#show(performance.now());
  }

  #show(time) {
    this.#first = this.#expected.first ?? this.#position ?? 0;
    this.#expected = null;
    if (!this.#showing) {
      this.#showing = true;
      this.#framesShown = 0;
      this.#unlocated = true;
      if (this.#started) this.#locate();
      this.#liveTracker = new PhaseTracker(this.#idle.fps, this.#idle.frames);
      this.#picture.dataset.shown = "live";
    }
    this.onShown(time);
  }

  // Where the two clocks meet. The first frame shown is the first one of the utterance or, if that was late, one after it;
  // so of all utterances the one with the smallest lag is right. In the middle of one only the time of day tells.
  #locate() {
    this.#unlocated = false;
    const { media_time: mediaTime, wall_ms: wallMs } = this.#started;
    const since = (this.#clock.at(performance.now()) - wallMs) / 1000 - TRANSIT_SECONDS;
    if (!this.#staying && since < MISSED_SECONDS) {
      const lag = this.#first - mediaTime;
      this.#lag = this.#lag === null || this.#guessed ? lag : Math.min(this.#lag, lag);
      this.#guessed = false;
    } else if (this.#lag === null) {
      this.#lag = (this.#position ?? 0) - mediaTime - since;
      this.#guessed = true;
    }
  }

  /** Shows the idle clip at once, or what the live picture shows in its stead. */
  cut() {
    this.#stopTimers();
    const spoke = this.#started !== null;
    if (!this.#expected || this.#expected !== this.#startedFor) this.#started = null; // else the next one waits to be seen
    this.#ended = null;
    if (this.#staying && this.#showing) {
      if (spoke) this.onReturned();
      return;
    }
    this.#idle.unfollow();
    if (!this.#showing) return;
    this.#showing = false;
    this.#picture.dataset.shown = "idle";
    this.onReturned();
  }

  /** Forgets what was expected and shows the idle clip. */
  abandon() {
    this.#expected = null;
    this.#ended = null;
    this.cut();
  }

  #stopTimers() {
    clearTimeout(this.#returnTimer);
    clearTimeout(this.#watchdog);
    this.#returnTimer = 0;
  }

  #onFrame(time, metadata) {
    const position = this.#positionOf(metadata);
    if (position === this.#position) return; // drawn again, not new
    this.#position = position;
    this.#seenAt = time;
    if (this.#showing) {
      this.#onLiveFrame(time);
    } else if (this.#lag !== null && this.#mediaTime() < this.#lastEnd - 0.5 / this.#idle.fps) {
      return; // of what was stopped just before
    } else if (this.#expected?.hold) {
      this.#expected.first ??= position;
      this.onReady();
    } else if (this.#expected) {
      this.#show(time);
      this.#onLiveFrame(time);
    }
  }

  #positionOf({ rtpTimestamp, mediaTime }) {
    if (rtpTimestamp === undefined) return mediaTime;
    if (this.#rtp === null) this.#position = 0;
    const step = this.#rtp === null ? 1 : (rtpTimestamp - this.#rtp) | 0; // wraps after 13 hours
    this.#rtp = rtpTimestamp;
    return this.#position + step / RTP_CLOCK;
  }

  #onLiveFrame(time) {
    this.#framesShown += 1;
    const media = this.#mediaTime();
    if (media !== null && this.#started) {
      const beat = (media - this.#started.media_time) * this.#idle.fps;
      if (this.#expected && this.#expected === this.#startedFor && beat > -0.5) this.#show(time); // an utterance that follows one still being seen
      this.#liveTracker.observe(this.#started.loop_frame + beat, time);
      if (this.#framesShown === SETTLING_FRAMES) this.#settle(time);
    }
    this.#planReturn();
  }

  #mediaTime() {
    return this.#lag === null || this.#position === null ? null : this.#position - this.#lag;
  }

  #settle(time) {
    const live = this.#liveTracker.at(time);
    const idle = this.#idle.at(time);
    if (live !== null && idle !== null) this.onMeasured(difference(live, idle, this.#idle.frames));
    this.#idle.follow((now) => this.#liveTracker.at(now));
  }

  // The idle clip comes back when the last frame has had its time, or a little earlier or later: when the clip shows the
  // frame that follows. Last frames that do not come are not waited for, or the picture would stand still.
  #planReturn() {
    const media = this.#mediaTime();
    if (!this.#ended || media === null) return;
    const { fps, frames } = this.#idle;
    const now = performance.now();
    const left = this.#ended.media_time - media; // seconds of what is seen
    if (left > LAST_FRAMES / fps && this.#patience > 0) return;
    let delay = this.#seenAt + left * 1000 - now;
    const idle = this.#idle.at(now);
    if (idle !== null && this.#started) {
      const next = this.#started.loop_frame + (this.#ended.media_time - this.#started.media_time) * fps;
      const later = (difference(next, idle, frames) * 1000) / fps - delay;
      const [least, most] = SHIFT_FRAMES.map((shift) => (shift * 1000) / fps);
      if (Math.abs(later) < 2 * most) delay += Math.max(least, Math.min(most, later));
    }
    clearTimeout(this.#returnTimer);
    this.#returnTimer = setTimeout(() => this.cut(), Math.max(0, delay - CHANGE_MS));
  }
}
