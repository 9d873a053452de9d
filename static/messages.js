// What is said to the user when something is not as it should be: one sentence, and what to do about it.

import { Problem, Unreachable } from "./api.js";
import { WebRtcFailed } from "./whep.js";

/** Text for an error of any kind. */
export function explain(error) {
  if (error instanceof Problem) return [error.message, error.advice].filter(Boolean).join(" ");
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

/** Text for the parts of a message that could not be read aloud. */
export function explainUnread(unread) {
  return `Left out, because it cannot be read aloud: ${unread.join(" ")}`;
}

export const MESSAGES = {
  loading: "Waking up…",
  idle: "Ready",
  preparing: "Getting ready to speak…",
  speaking: "Speaking",
  blank: "Type something for Mary to say.",
  fellBack: "WebRTC could not get through here, so Mary speaks over plain HTTP.",
  lost: "The connection was lost. Press Speak to try again.",
  retrying: "Trying again every few seconds.",
};
