// The link to the finished video of the last utterance, offered as soon as the service has finished it.

import { request } from "./api.js";

const NOT_READY = 409;
const TRY_MS = [200, 300, 600, 1000, 2000, 4000, 8000];

const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

export class Download {
  #link;
  #wanted = "";

  /** link: the `<a>` element. */
  constructor(link) {
    this.#link = link;
    this.withdraw();
  }

  withdraw() {
    this.#wanted = "";
    this.#link.removeAttribute("href");
    this.#link.setAttribute("aria-disabled", "true");
  }

  /** Waits until the video of `utterance` is at `url`, then enables the link. */
  async offer(url, utterance) {
    this.withdraw();
    this.#wanted = url;
    for (const delay of TRY_MS) {
      await pause(delay);
      if (this.#wanted !== url) return;
      try {
        const answer = await request(url, { headers: { Range: "bytes=0-0" } });
        await answer.body?.cancel();
        if (this.#wanted === url) this.#enable(url, utterance);
        return;
      } catch (error) {
        if (error.status !== NOT_READY) return; // cut short before anything was made, or away: nothing to offer
      }
    }
  }

  #enable(url, utterance) {
    this.#link.href = url;
    this.#link.download = `mary-${utterance}.mp4`;
    this.#link.removeAttribute("aria-disabled");
  }
}
