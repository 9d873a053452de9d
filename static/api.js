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

export class Api {
  #clock;

  constructor(clock) {
    this.#clock = clock;
  }

  avatars() {
    return this.#json("GET", "/v1/avatars");
  }

  voices() {
    return this.#json("GET", "/v1/voices");
  }

  /** Returns the new stream: id, urls, utterance, idle. */
  createStream(options) {
    return this.#json("POST", "/v1/streams", options);
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
