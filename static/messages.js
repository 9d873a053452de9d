// What is said to the user when something is not as it should be: one sentence, and what to do about it.

import { Problem, Unreachable } from "./api.js";
import { WebRtcFailed } from "./whep.js";

/** Text for an error of any kind. */
export function explain(error) {
  if (error instanceof Problem) return [error.message, ADVICE[error.slug] ?? error.advice].filter(Boolean).map(sentence).join(" ");
  if (error instanceof Unreachable) {
    return navigator.onLine
      ? "The service cannot be reached. It may have stopped; try again in a moment."
      : "This device is offline. Connect to the network and try again.";
  }
  if (error instanceof WebRtcFailed) {
    return `${error.message} Choose “Automatic” or “Fragmented MP4” under Voice and settings to hear Mary over plain HTTP.`;
  }
  return error.message || "Something went wrong. Try again.";
}

/** What to do on this page, where the service's own advice is for programmers. */
const ADVICE = {
  "too-long": "Shorten it, or say it in several parts.",
};

function sentence(text) {
  const whole = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?…]$/.test(whole) ? whole : `${whole}.`;
}

/** Text for the parts of a message that could not be read aloud. */
export function explainUnread(unread) {
  return `Left out, because it cannot be read aloud: ${unread.join(" ")}`;
}

export const MESSAGES = {
  loading: "Waking up…",
  ended: "Ended",
  streamEnded: "The stream has ended.",
  idle: "Ready",
  preparing: "Getting ready to speak…",
  speaking: "Speaking",
  blank: "Type something for Mary to say.",
  fellBack: "WebRTC could not get through here, so the picture comes over plain HTTP.",
  lost: "The connection was lost. Press Speak to try again.",
  retrying: "Trying again every few seconds.",
};
