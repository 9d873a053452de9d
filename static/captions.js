// What she is saying, a line or two at a time. The service does not say yet when each word is spoken, so the pace is
// estimated from the text and corrected by how long earlier utterances took.

const PAGE_CHARACTERS = 110;
const SENTENCE_CHARACTERS = 30; // shorter ones share a page
const SENTENCE_END = /[.!?]["”’)]*$/;
const FIRST_PACE = 0.062; // seconds for a letter at speed 1
const PAUSES = [
  [SENTENCE_END, 8], // letters' worth of silence after a sentence
  [/[,;:]$/, 4],
];

/** The text cut into pieces that fit two lines, at sentence ends where possible. */
export function pages(text) {
  const result = [];
  for (const paragraph of text.split(/\n+/)) {
    let page = "";
    for (const word of paragraph.split(/\s+/).filter(Boolean)) {
      const full = page.length + word.length >= PAGE_CHARACTERS;
      const sentenceEnded = page.length >= SENTENCE_CHARACTERS && SENTENCE_END.test(page);
      if (page && (full || sentenceEnded)) {
        result.push(page);
        page = "";
      }
      page = page ? `${page} ${word}` : word;
    }
    if (page) result.push(page);
  }
  return result;
}

/** How long a piece of text takes to say, in letters. */
export function weight(text) {
  return text.split(/\s+/).reduce((sum, word) => {
    const pause = PAUSES.find(([ending]) => ending.test(word));
    return sum + word.length + 1 + (pause ? pause[1] : 0);
  }, 0);
}

export class Captions {
  #element;
  #pace = new Map(); // by voice
  #current = null;
  #timer = 0;
  #enabled = true;

  constructor(element) {
    this.#element = element;
    this.#show("");
  }

  set enabled(enabled) {
    this.#enabled = enabled;
    this.#element.hidden = !enabled || !this.#element.textContent;
  }

  /** She begins to say `words`: {text, voice?, speed}. */
  begin(words) {
    this.clear();
    this.#current = { words, began: performance.now() };
    this.#turnTo(pages(words.text), 0);
  }

  /** She has said all of it. */
  complete() {
    if (this.#current) {
      const { words, began } = this.#current;
      const seconds = (performance.now() - began) / 1000;
      this.#pace.set(words.voice, (seconds * words.speed) / weight(words.text));
    }
    this.clear();
  }

  clear() {
    clearTimeout(this.#timer);
    this.#current = null;
    this.#show("");
  }

  #turnTo(all, index) {
    this.#show(all[index] ?? "");
    if (index + 1 >= all.length) return;
    const { words } = this.#current;
    const seconds = (weight(all[index]) * (this.#pace.get(words.voice) ?? FIRST_PACE)) / words.speed;
    this.#timer = setTimeout(() => this.#turnTo(all, index + 1), seconds * 1000);
  }

  #show(text) {
    this.#element.textContent = text;
    this.#element.hidden = !this.#enabled || !text;
  }
}
