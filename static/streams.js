// Which stream is watched: one made for the purpose and ended afterwards, or one that somebody else has made.

import { Problem } from "./api.js";

/** What to raise when the service has ended a stream. */
export function streamEnded() {
  return new Problem({ status: 410, detail: "The stream has ended." });
}

/** Streams of one's own. */
export class OwnStreams {
  own = true;
  #api;

  constructor(api) {
    this.#api = api;
  }

  async open(avatar) {
    return { ...(await this.#api.createStream({ avatar, idle: "local" })), continuous: false };
  }

  end(stream) {
    this.#api.end(stream);
  }
}

/** The stream at `url`, which goes on without us. */
export class JoinedStream {
  own = false;
  #api;
  #url;

  constructor(api, url) {
    this.#api = api;
    this.#url = url;
  }

  /** Returns the stream; `continuous`: the service sends its picture also while nothing is said. */
  async open() {
    const stream = await this.#api.stream(this.#url);
    if (stream.state === "ended") throw streamEnded();
    return { ...stream, continuous: stream.idle === "stream" };
  }

  end() {}
}

/** `{server, url}` of a stream given by its id, or by its address on whatever server it is. */
export function locateStream(given, server) {
  const { href } = new URL(given.includes("/") ? given : `v1/streams/${encodeURIComponent(given)}`, server);
  const [url, base] = /^(.*?\/)v1\/streams\/[^/?#]+/.exec(href) ?? [];
  if (!url) throw new Error(`“${given}” is neither the id nor the address of a stream.`);
  return { server: base, url };
}
