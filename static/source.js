// A source buffer one can wait for, and how to get one.

const MediaSourceClass = globalThis.MediaSource ?? globalThis.ManagedMediaSource;

/** Whether this browser plays media that a script hands it. */
export const mediaSourceSupported = MediaSourceClass !== undefined;

function once(target, name) {
  return new Promise((resolve, reject) => {
    target.addEventListener(name, resolve, { once: true });
    target.addEventListener("error", () => reject(new Error(`the browser refused the media (${name})`)), { once: true });
  });
}

/** Appends to one source buffer, one piece after the other. */
export class Appender {
  #last = Promise.resolve();

  constructor(mediaSource, buffer, objectUrl) {
    this.mediaSource = mediaSource;
    this.buffer = buffer;
    this.objectUrl = objectUrl;
  }

  /** Resolves when `bytes` are in; `offset` in seconds is added to their times. */
  append(bytes, offset = 0) {
    return this.#then(() => {
      if (this.buffer.timestampOffset !== offset) this.buffer.timestampOffset = offset;
      this.buffer.appendBuffer(bytes);
    });
  }

  /** Media time of the first thing that is in, Infinity when nothing is. */
  get start() {
    const { buffered } = this.buffer;
    return buffered.length ? buffered.start(0) : Infinity;
  }

  remove(start, end) {
    return this.#then(() => this.buffer.remove(start, end));
  }

  /** Says that nothing more will come. */
  end() {
    this.#last = this.#last.then(() => {
      if (this.mediaSource.readyState === "open") this.mediaSource.endOfStream();
    });
    return this.#last;
  }

  release() {
    URL.revokeObjectURL(this.objectUrl);
  }

  #then(action) {
    this.#last = this.#last.then(async () => {
      if (this.mediaSource.readyState === "closed") throw new DOMException("the player was closed", "AbortError");
      const done = once(this.buffer, "updateend");
      action();
      await done;
    });
    return this.#last;
  }
}

/** Gives `video` a new media source and returns its `Appender` for media of `type`. */
export async function openSource(video, type) {
  if (!mediaSourceSupported || !MediaSourceClass.isTypeSupported(type)) throw new Error(`the browser cannot play ${type}`);
  const mediaSource = new MediaSourceClass();
  const objectUrl = URL.createObjectURL(mediaSource);
  const opened = once(mediaSource, "sourceopen");
  video.disableRemotePlayback = true; // Safari hands out managed sources only so
  video.src = objectUrl;
  await opened;
  return new Appender(mediaSource, mediaSource.addSourceBuffer(type), objectUrl);
}
