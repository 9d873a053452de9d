// What happens on a stream, as the service tells it (server-sent events).

const NAMES = ["state", "speak_started", "word", "mark", "viseme", "speak_ended", "error"];

export class StreamEvents {
  #source;

  /** Calls `onEvent(name, data)` for every event, and `onGone()` once when the service has no such stream any more. */
  constructor(url, onEvent, onGone) {
    this.#source = new EventSource(url);
    for (const name of NAMES) {
      this.#source.addEventListener(name, (event) => {
        // "error" is also what the browser calls a broken connection; only the service's own events carry data.
        if (event.data !== undefined) onEvent(name, JSON.parse(event.data));
        else if (this.#source.readyState === EventSource.CLOSED) onGone();
      });
    }
  }

  /** Resolves when nothing that happens from now on will be missed, or after `limit` ms. */
  opened(limit) {
    return new Promise((resolve) => {
      if (this.#source.readyState === EventSource.OPEN) resolve();
      this.#source.addEventListener("open", resolve, { once: true });
      setTimeout(resolve, limit);
    });
  }

  close() {
    this.#source.close();
  }
}
