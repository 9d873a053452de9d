// What is inside <mary-avatar>: two videos on top of each other, badge, caption, message, and the button for the sound.

import { avatarStyle, shapeStyle } from "./avatar_style.js";

const SVG = "http://www.w3.org/2000/svg";
const LOUDSPEAKER = "M4 9.5v5h3.5L12 18.5v-13L7.5 9.5zM15.5 9a4 4 0 0 1 0 6M18 6.5a8 8 0 0 1 0 11";

function build(name, properties = {}, ...children) {
  const element = document.createElement(name);
  Object.assign(element, properties);
  element.append(...children);
  return element;
}

function video(id) {
  const element = build("video", { id, playsInline: true, disablePictureInPicture: true, tabIndex: -1 });
  element.setAttribute("aria-hidden", "true");
  return element;
}

function loudspeaker() {
  const icon = document.createElementNS(SVG, "svg");
  icon.setAttribute("viewBox", "0 0 24 24");
  icon.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", LOUDSPEAKER);
  icon.append(path);
  return icon;
}

export class AvatarView {
  idle = video("idle");
  live = video("live");
  caption = build("p", { id: "caption", className: "caption", hidden: true });
  unblock = build("button", { id: "unblock", className: "unblock", type: "button", hidden: true });
  /** Holds both videos; its `data-shown` says which one is seen. */
  picture = build("div", { id: "frame", className: "picture" }, this.idle, this.live);
  #badge = build("span", { id: "badge", className: "badge" });
  #message = build("p", { id: "message", className: "message", role: "alert", hidden: true });
  #root;

  constructor(root) {
    this.#root = root;
    this.picture.setAttribute("role", "img");
    this.name("");
    this.shape(1, 1);
    root.replaceChildren(this.picture, this.#badge, this.caption, this.unblock, this.#message);
  }

  /** The avatar's name; screen readers say it, and the button. */
  name(title) {
    const name = title || "The avatar";
    this.picture.setAttribute("aria-label", `${name}, a talking head`);
    this.unblock.replaceChildren(loudspeaker(), `Click to hear ${title || "the sound"}`);
  }

  /** Width and height of the avatar's picture in pixels. */
  shape(width, height) {
    this.#root.adoptedStyleSheets = [avatarStyle(), shapeStyle(width, height)];
  }

  badge(text) {
    this.#badge.textContent = text;
    this.#badge.hidden = !text;
  }

  message(text) {
    this.#message.textContent = text;
    this.#message.hidden = !text;
  }
}
