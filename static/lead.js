// By how much something must begin earlier to be in time: what it would have taken the last times, in the middle, so that
// a single late one does not spoil the next.

const KEPT = 5;

export class Lead {
  #first;
  #least;
  #most;
  #needed = [];

  /** All in ms; `first` holds until something has been measured. */
  constructor(first, least, most) {
    this.#first = first;
    this.#least = least;
    this.#most = most;
  }

  get milliseconds() {
    if (this.#needed.length === 0) return this.#first;
    const sorted = [...this.#needed].sort((a, b) => a - b);
    const middle = sorted.length / 2 - 0.5;
    return (sorted[Math.floor(middle)] + sorted[Math.ceil(middle)]) / 2;
  }

  /** With the lead as it is, it was `late` ms behind. */
  learn(late) {
    this.#needed.push(Math.max(this.#least, Math.min(this.#most, this.milliseconds + late)));
    if (this.#needed.length > KEPT) this.#needed.shift();
  }
}
