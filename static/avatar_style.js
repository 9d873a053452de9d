// How <mary-avatar> looks inside. A script's own sheet, because a foreign page's Content-Security-Policy that lets the
// script in need not let in a style sheet from the same place.

const CSS = `
:host {
  display: block;
  position: relative;
  overflow: hidden;
  container-type: inline-size;
  background: #80868e;
  font: 16px/1.45 system-ui, "Segoe UI", Roboto, "Helvetica Neue", "Noto Sans", "DejaVu Sans", sans-serif;
}

:host([hidden]),
[hidden] {
  display: none !important;
}

*,
*::before,
*::after {
  box-sizing: border-box;
}

/* The idle clip lies below and never stops; the live video only becomes visible. No transition: the frames of both
   match, a fade would show twice the face. */

.picture,
video {
  position: absolute;
  inset: 0;
  display: block;
  width: 100%;
  height: 100%;
}

video {
  object-fit: inherit;
}

.picture {
  object-fit: cover;
}

#live {
  opacity: 0;
}

[data-shown="live"] #live {
  opacity: 1;
}

.badge {
  position: absolute;
  top: 14px;
  right: 14px;
  padding: 2px 9px;
  border-radius: 99px;
  background: rgb(17 20 24 / 42%);
  color: rgb(255 255 255 / 86%);
  font-size: 11.5px;
  letter-spacing: 0.02em;
}

/* Words come one by one and stay where they are: text that is centred would move with every one. */

.caption {
  position: absolute;
  inset: auto 0 0;
  margin: 0;
  min-height: calc(2lh + 50px); /* the first line stays where it is when the second one begins */
  padding: 34px max(16px, calc(50cqi - 15em)) 16px;
  background: linear-gradient(transparent, rgb(10 12 15 / 78%) 38px);
  color: rgb(255 255 255 / 82%);
  font-size: clamp(14px, 3.2cqi, 19px);
  line-height: 1.45;
}

.caption .now {
  color: #fff;
  text-shadow: 0 0 12px rgb(255 255 255 / 45%);
}

.message {
  position: absolute;
  inset: auto 12px 12px;
  margin: 0;
  padding: 10px 14px;
  border-radius: 12px;
  background: rgb(55 32 29 / 94%);
  color: #ffb4a8;
  font-size: clamp(12px, 3cqi, 14.5px);
}

.unblock {
  position: absolute;
  inset: auto auto 22px 50%;
  translate: -50% 0;
  display: flex;
  gap: 10px;
  align-items: center;
  min-height: 44px;
  max-width: calc(100% - 16px);
  padding: 8px 22px 8px 18px;
  border: 0;
  border-radius: 99px;
  background: #eef0f3;
  color: #111418;
  font: inherit;
  font-weight: 600;
  box-shadow: 0 8px 30px rgb(0 0 0 / 40%);
  cursor: pointer;
}

.caption:not([hidden]) ~ .unblock {
  bottom: 112px;
}

.unblock:focus-visible {
  outline: 2px solid #e9a184;
  outline-offset: 2px;
}

svg {
  flex: none;
  width: 22px;
  height: 22px;
  fill: none;
  stroke: currentcolor;
  stroke-width: 1.7;
  stroke-linecap: round;
  stroke-linejoin: round;
}
`;

let shared = null;

/** The sheet that all elements share. */
export function avatarStyle() {
  if (!shared) {
    shared = new CSSStyleSheet();
    shared.replaceSync(CSS);
  }
  return shared;
}

/** A sheet that gives an element the shape of a picture of `width` by `height`, unless the page sizes it. */
export function shapeStyle(width, height) {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(`:host { aspect-ratio: ${width} / ${height}; }`);
  return sheet;
}
