// Volume, and what to do when the browser will not let a page make sound before the user has touched it.

export class Sound {
  #video;
  #muted = false;
  #blocked = false;

  /** Called with true when sound needs a click, with false when it has had it. */
  onBlocked = () => {};

  constructor(video) {
    this.#video = video;
  }

  /** volume: 0 to 1. */
  set({ volume, muted }) {
    this.#muted = muted;
    this.#video.volume = volume;
    this.#apply();
  }

  /** Starts the video, with sound if the browser allows it, otherwise muted. */
  async play() {
    try {
      // A muted video may always play; that alone does not mean that it may be heard now.
      if (this.#blocked && navigator.userActivation?.hasBeenActive) this.#setBlocked(false);
      await this.#video.play();
    } catch (error) {
      if (error.name !== "NotAllowedError") return; // AbortError: another source came in between
      this.#setBlocked(true);
      await this.#video.play().catch(() => {});
    }
  }

  /** The user has clicked: sound is allowed now. */
  unblock() {
    this.#setBlocked(false);
    return this.play();
  }

  #setBlocked(blocked) {
    this.#blocked = blocked;
    this.#apply();
    this.onBlocked(blocked);
  }

  #apply() {
    this.#video.muted = this.#muted || this.#blocked;
  }
}
