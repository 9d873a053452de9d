// The choices: avatar, voice, speed, transport, volume, captions. Shows them, keeps them, tells when they change.

import { loadPreferences, savePreferences } from "./preferences.js";

const DEFAULTS = { avatar: "", voice: "", speed: 1, transport: "auto", volume: 1, muted: false, captions: true };
const within = (least, most) => (number) => number >= least && number <= most;
const ACCEPTS = {
  speed: within(0.5, 2),
  volume: within(0, 1),
  transport: (name) => ["auto", "webrtc", "mp4", "flv"].includes(name),
};

function option(value, label, disabled = false) {
  const element = document.createElement("option");
  Object.assign(element, { value, textContent: label, disabled });
  return element;
}

function voiceLabel({ name, language, sex, installed, missing }) {
  const label = [name, language, sex].filter(Boolean).join(" · ");
  return installed ? label : `${label} (needs ${missing || "an extra"})`;
}

export class Settings {
  values = loadPreferences(DEFAULTS, ACCEPTS);
  #elements;

  /** Called with the name of what has changed. */
  onChange = () => {};

  /** elements: the controls by name: avatar, voice, speed, speedValue, transport, volume, mute, captions. */
  constructor(elements) {
    this.#elements = elements;
    for (const name of ["avatar", "voice", "transport"]) {
      elements[name].addEventListener("change", () => this.#set(name, elements[name].value));
    }
    elements.speed.addEventListener("input", () => this.#set("speed", Number(elements.speed.value)));
    elements.volume.addEventListener("input", () => {
      this.values.muted = false;
      this.#set("volume", Number(elements.volume.value));
    });
    elements.mute.addEventListener("click", () => this.#set("muted", !this.values.muted));
    elements.captions.addEventListener("click", () => this.#set("captions", !this.values.captions));
    this.#show();
  }

  /** Fills the lists with what the service has: the answers of /v1/avatars and /v1/voices. */
  offer({ avatars, default: defaultAvatar }, { voices }) {
    const { avatar, voice } = this.#elements;
    avatar.replaceChildren(...avatars.map(({ id, title }) => option(id, title)));
    if (!avatars.some(({ id }) => id === this.values.avatar)) this.values.avatar = defaultAvatar;
    voice.replaceChildren(
      option("", "The avatar’s own"),
      ...voices.map((entry) => option(entry.id, voiceLabel(entry), !entry.installed)),
    );
    if (!voices.some(({ id, installed }) => id === this.values.voice && installed)) this.values.voice = "";
    this.#show();
  }

  /** Offers the transport of that name no more. */
  withhold(name) {
    this.#elements.transport.querySelector(`[value="${name}"]`)?.remove();
    if (this.values.transport === name) this.values.transport = DEFAULTS.transport;
    this.#show();
  }

  #set(name, value) {
    this.values[name] = value;
    this.#show();
    savePreferences(this.values);
    this.onChange(name);
  }

  #show() {
    const { values } = this;
    const elements = this.#elements;
    for (const name of ["avatar", "voice", "transport", "speed"]) elements[name].value = values[name];
    elements.speedValue.textContent = `${values.speed.toFixed(2).replace(/0$/, "")}×`;
    elements.volume.value = values.muted ? 0 : values.volume;
    elements.mute.setAttribute("aria-pressed", String(values.muted));
    elements.captions.setAttribute("aria-pressed", String(values.captions));
  }
}
