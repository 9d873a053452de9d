// Watching over WebRTC: the WHEP protocol (draft-ietf-wish-whep), one offer, one answer, no trickling.

import { Problem, request } from "./api.js";

const GATHERING_MS = 300; // the service finds us by our first packet; waiting longer for candidates gains little
const CONNECTING_MS = 5000;
const DISCONNECTED_MS = 3000; // short losses heal by themselves

/** The media could not be got through by WebRTC (as opposed to: the service refused or is away). */
export class WebRtcFailed extends Error {
  constructor(message, iceServers = []) {
    super(message);
    this.name = "WebRtcFailed";
    this.iceServers = iceServers;
  }
}

const QUOTED = String.raw`"((?:[^"\\]|\\.)*)"`; // quoted-string of HTTP
const LINK = new RegExp(String.raw`<([^>]+)>((?:\s*;\s*[\w-]+\s*=\s*(?:${QUOTED}|[^",;\s]+))*)`, "g");
const PARAMETER = new RegExp(String.raw`;\s*([\w-]+)\s*=\s*(?:${QUOTED}|([^",;\s]+))`, "g");

/** ICE servers named in a `Link` header, for `RTCPeerConnection`. */
export function iceServersOf(link) {
  const servers = [];
  for (const [, urls, parameters] of (link ?? "").matchAll(LINK)) {
    const values = {};
    for (const [, key, quoted, bare] of parameters.matchAll(PARAMETER)) values[key] = quoted?.replace(/\\(.)/g, "$1") ?? bare;
    if (values.rel !== "ice-server") continue;
    const server = { urls };
    if (values.username) Object.assign(server, { username: values.username, credential: values.credential });
    servers.push(server);
  }
  return servers;
}

function gathered(peer) {
  return new Promise((resolve) => {
    setTimeout(resolve, GATHERING_MS);
    peer.addEventListener("icegatheringstatechange", () => peer.iceGatheringState === "complete" && resolve());
  });
}

export class WhepViewer {
  #peer;
  #location = "";
  #onLost;
  #lossTimer = 0;

  /** media: the MediaStream that the viewer's tracks are in; onLost: called once when an established connection dies. */
  constructor(iceServers, onLost) {
    this.media = new MediaStream();
    this.#onLost = onLost;
    this.#peer = new RTCPeerConnection({ iceServers, bundlePolicy: "max-bundle" });
  }

  /** Resolves when media can flow. Raises WebRtcFailed, Unreachable, or Problem when the stream has ended. */
  async connect(url) {
    const peer = this.#peer;
    for (const kind of ["video", "audio"]) {
      const { receiver } = peer.addTransceiver(kind, { direction: "recvonly" });
      if ("jitterBufferTarget" in receiver) receiver.jitterBufferTarget = 0; // as little delay as the network allows
      this.media.addTrack(receiver.track);
    }
    let offered = [];
    try {
      await peer.setLocalDescription();
      await gathered(peer);
      const answer = await request(url, {
        method: "POST",
        headers: { "Content-Type": "application/sdp" },
        body: peer.localDescription.sdp,
      });
      const location = answer.headers.get("Location");
      if (location) this.#location = new URL(location, answer.url).href;
      offered = iceServersOf(answer.headers.get("Link"));
      await peer.setRemoteDescription({ type: "answer", sdp: await answer.text() });
      await this.#connected();
    } catch (error) {
      this.close();
      const refused = error instanceof Problem && ![404, 410].includes(error.status); // not: the stream is gone
      if (!refused && !(error instanceof WebRtcFailed) && !(error instanceof DOMException)) throw error;
      throw new WebRtcFailed(error.message, offered);
    }
    peer.addEventListener("connectionstatechange", () => this.#onStateChange());
  }

  /** leave: tell the service; needless when the stream ends with it. */
  close({ leave = true } = {}) {
    clearTimeout(this.#lossTimer);
    this.#onLost = () => {};
    this.#peer.close();
    if (this.#location && leave) fetch(this.#location, { method: "DELETE", keepalive: true }).catch(() => {});
    this.#location = "";
  }

  #connected() {
    const peer = this.#peer;
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => reject(new WebRtcFailed("No WebRTC connection within 5 seconds.")), CONNECTING_MS);
      const check = () => {
        if (peer.connectionState === "connected") resolve();
        else if (["failed", "closed"].includes(peer.connectionState)) reject(new WebRtcFailed("The WebRTC connection failed."));
        else return;
        clearTimeout(timer);
      };
      peer.addEventListener("connectionstatechange", check);
      check();
    });
  }

  #onStateChange() {
    clearTimeout(this.#lossTimer);
    const state = this.#peer.connectionState;
    if (state === "failed" || state === "closed") this.#lose();
    else if (state === "disconnected") this.#lossTimer = setTimeout(() => this.#lose(), DISCONNECTED_MS);
  }

  #lose() {
    const onLost = this.#onLost;
    this.close();
    onLost();
  }
}
