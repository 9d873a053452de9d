// The service's HTTP interface. Every failure becomes a `Problem` (the service said no) or `Unreachable` (it said nothing).

export class Problem extends Error {
  /** document: an RFC 9457 problem document. */
  constructor(document) {
    super(document.detail || document.title || `The service answered ${document.status}.`);
    this.name = "Problem";
    this.status = document.status;
    this.slug = (document.type ?? "").split("/").pop();
    this.advice = document.advice ?? "";
    this.field = document.field ?? "";
  }
}

export class Unreachable extends Error {
  constructor(cause) {
    super("The service cannot be reached.", { cause });
    this.name = "Unreachable";
  }
}

/** The `Problem` that an unsuccessful answer stands for, whatever its body is. */
export async function problemOf(answer) {
  const isProblem = (answer.headers.get("content-type") ?? "").includes("problem+json");
  const document = isProblem ? await answer.json().catch(() => ({})) : {};
  return new Problem({ title: `The service answered ${answer.status}.`, ...document, status: answer.status });
}

/** `fetch` with the two kinds of failure told apart; an aborted request still raises AbortError. */
export async function request(url, options = {}) {
  let answer;
  try {
    answer = await fetch(url, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Unreachable(error);
  }
  if (!answer.ok) throw await problemOf(answer);
  return answer;
}

/** Where the service is: these files are its own. */
export const SERVER = new URL("..", import.meta.url).href;

const STREAM_FILES = { whep: "whep", mp4: "live.mp4", video: "video.mp4", events: "events" };

export class Api {
  #clock;
  #server;

  /** server: the service's address, which all its paths are under. Addresses returned are complete. */
  constructor(clock, server = SERVER) {
    this.#clock = clock;
    this.#server = server.replace(/\/+$/, "");
  }

  /** Returns `{default, avatars}`. */
  async avatars() {
    const answer = await this.#json("GET", this.#at("/v1/avatars"));
    const avatars = answer.avatars.map((one) => ({ ...one, idle: this.#at(one.idle), preview: this.#at(one.preview) }));
    return { ...answer, avatars };
  }

  voices() {
    return this.#json("GET", this.#at("/v1/voices"));
  }

  /** Returns the new stream: id, urls, utterance, idle. */
  async createStream(options) {
    const stream = await this.#json("POST", this.#at("/v1/streams"), options);
    const urls = Object.entries(stream.urls).map(([name, path]) => [name, this.#at(path)]);
    return { ...stream, urls: Object.fromEntries(urls) };
  }

  /** Returns the stream at `url` that somebody else has made: its report, and urls. */
  async stream(url) {
    const report = await this.#json("GET", url);
    const files = Object.entries(STREAM_FILES).map(([name, file]) => [name, `${url}/${file}`]);
    return { ...report, urls: { self: url, ...Object.fromEntries(files) } };
  }

  /** Returns `{id, unread}` of the utterance. */
  async say(stream, words) {
    return (await this.#json("POST", `${stream.urls.self}/say`, words)).utterance;
  }

  interrupt(stream) {
    return this.#json("POST", `${stream.urls.self}/interrupt`);
  }

  /** Ends the stream, also while the page is being closed. Failures do not matter: streams end themselves. */
  end(stream) {
    return fetch(stream.urls.self, { method: "DELETE", keepalive: true }).catch(() => {});
  }

  /** Reports how long after Enter the first live frame was seen. */
  shown(stream, utterance, milliseconds) {
    const path = `${stream.urls.self}/utterances/${encodeURIComponent(utterance)}/shown`;
    return this.#json("POST", path, { milliseconds });
  }

  #at(path) {
    return this.#server + path;
  }

  async #json(method, url, body) {
    const options = { method, headers: { Accept: "application/json" } };
    if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    const sent = performance.now();
    const answer = await request(url, options);
    const received = performance.now();
    if (answer.status === 204) return null;
    const result = await answer.json();
    if (typeof result.server_time_ms === "number") this.#clock.observe(sent, received, result.server_time_ms);
    return result;
  }
}
