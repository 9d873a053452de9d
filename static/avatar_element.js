// The element <mary-avatar>: attributes, properties, methods and events (docs/embedding.md).

import { SERVER } from "./api.js";
import { AvatarView } from "./avatar_view.js";
import { explain } from "./messages.js";
import { Player } from "./player.js";

const BADGE = "AI-generated";
const TRANSPORTS = ["auto", "webrtc", "mp4", "flv"];
const STRINGS = ["avatar", "badge", "server", "stream", "transport", "voice"];
const NUMBERS = { speed: [0.5, 2], volume: [0, 1] }; // least and most; 1 is the default
const PROPERTIES = [...STRINGS, ...Object.keys(NUMBERS), "captions", "muted"];

export class MaryAvatar extends HTMLElement {
  static observedAttributes = ["avatar", "badge", "captions", "muted", "server", "stream", "transport", "volume"];

  #root = this.attachShadow({ mode: "open" });
  #internals = this.attachInternals();
  #view = null;
  #player = null;
  #state = "loading";

  constructor() {
    super();
    this.#internals.role = "group";
    this.#internals.ariaLabel = "Avatar";
  }

  connectedCallback() {
    // What a script has set before the element was defined hides the properties below.
    for (const name of PROPERTIES) {
      if (!Object.hasOwn(this, name)) continue;
      const value = this[name];
      delete this[name];
      this[name] = value;
    }
    if (!this.#player) this.#begin();
    addEventListener("pagehide", this.#onPageHide);
  }

  disconnectedCallback() {
    removeEventListener("pagehide", this.#onPageHide);
    // It may only be moved, which is leaving and coming back at once.
    queueMicrotask(() => !this.isConnected && this.#end());
  }

  attributeChangedCallback(name, before, now) {
    if (!this.#player || before === now) return;
    if (name === "server" || name === "stream") {
      this.#end();
      this.#begin();
    } else this.#apply();
  }

  /** "loading", "idle", "preparing", "speaking", or "ended" when the stream of somebody else's has ended. */
  get state() {
    return this.#state;
  }

  /** Whether the live picture is seen, not the idle clip. */
  get live() {
    return this.#view?.picture.dataset.shown === "live";
  }

  get speed() {
    return this.#number("speed");
  }

  set speed(value) {
    this.setAttribute("speed", value);
  }

  get volume() {
    return this.#number("volume");
  }

  set volume(value) {
    this.setAttribute("volume", value);
  }

  get muted() {
    return this.hasAttribute("muted");
  }

  set muted(muted) {
    this.toggleAttribute("muted", Boolean(muted));
  }

  get captions() {
    return this.getAttribute("captions") !== "off";
  }

  set captions(captions) {
    if (captions) this.removeAttribute("captions");
    else this.setAttribute("captions", "off");
  }

  /** Connects, so that the first word need not wait for it. */
  prepare() {
    return this.#player?.prepare();
  }

  /**
   * Has `text` said, after what is being said; `interrupt`: instead of it. Resolves to `{id, unread}` of the utterance
   * when the service has taken it, and to null when it is not said; the event `problem` tells why.
   * since: page time from which `shown` counts. voice, speed: instead of the element's own.
   */
  async say(text, { interrupt = false, voice = this.voice, speed = this.speed, since } = {}) {
    const words = { text: String(text), speed };
    if (voice) words.voice = voice;
    return (await this.#player?.say(words, { interrupt, enteredAt: since })) ?? null;
  }

  /** Cuts short what is being said, and forgets what was to follow. */
  async stop() {
    await this.#player?.stop();
  }

  interrupt() {
    return this.stop();
  }

  /** Gives back connection and stream; the next `say` makes new ones. */
  close() {
    this.#player?.close();
  }

  #begin() {
    this.#view = new AvatarView(this.#root);
    const { server, stream } = this;
    try {
      const options = { server: new URL(server || SERVER, document.baseURI).href, stream };
      this.#player = new Player(this.#view, (name, detail) => this.#happened(name, detail), options);
      this.#apply();
    } catch (error) {
      this.#happened("problem", { text: explain(error) });
    }
  }

  #end() {
    this.#player?.release();
    this.#player = null;
    this.#root.replaceChildren();
    this.#view = null;
    this.#setState("loading");
  }

  #apply() {
    const { avatar, badge, captions, muted, transport, volume } = this;
    this.#view.badge(badge === "off" ? "" : badge || BADGE);
    this.#player.captions(captions);
    this.#player.sound({ volume, muted });
    this.#player.choose({ avatar, transport: TRANSPORTS.includes(transport) ? transport : "auto" });
  }

  #onPageHide = () => this.close();

  #happened(name, detail) {
    if (name === "state") return this.#setState(detail.state);
    const event = new CustomEvent(name, { detail, bubbles: true, composed: true, cancelable: name === "problem" });
    const shown = this.dispatchEvent(event);
    if (name === "problem" && shown) this.#view?.message(detail.text);
    if (name === "loaded") this.#internals.ariaLabel = detail.title;
    return undefined;
  }

  #setState(state) {
    if (state === this.#state) return;
    this.#state = state;
    if (state !== "ended") this.#view?.message("");
    this.dispatchEvent(new CustomEvent("state", { detail: { state }, bubbles: true, composed: true }));
  }

  #number(name) {
    const [least, most] = NUMBERS[name];
    const value = Number.parseFloat(this.getAttribute(name));
    return Number.isNaN(value) ? 1 : Math.max(least, Math.min(most, value));
  }
}

for (const name of STRINGS) {
  Object.defineProperty(MaryAvatar.prototype, name, {
    get() {
      return this.getAttribute(name) ?? "";
    },
    set(value) {
      if (value === null || value === undefined || value === "") this.removeAttribute(name);
      else this.setAttribute(name, value);
    },
    enumerable: true,
    configurable: true,
  });
}
