// The server's clock, seen from the page. Every answer that carries `server_time_ms` is a sample; the sample with the
// shortest round trip is the one to trust, because the error is at most half of it.

const KEPT_SAMPLES = 16;

export class ServerClock {
  #samples = [];

  /** Takes one sample: times of request and answer on `performance.now()`, the server's unix time in ms. */
  observe(sent, received, serverMs) {
    const offset = serverMs - (sent + received) / 2;
    this.#samples.push({ offset, roundTrip: received - sent });
    if (this.#samples.length > KEPT_SAMPLES) this.#samples.shift();
  }

  /** Unix ms on the server at page time `time` (ms of `performance.now()`). Before any sample: the page's own clock. */
  at(time) {
    const best = this.#samples.reduce((a, b) => (b.roundTrip < a.roundTrip ? b : a), {
      offset: performance.timeOrigin,
      roundTrip: Infinity,
    });
    return time + best.offset;
  }
}
