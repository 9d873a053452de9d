// What she is saying: two lines that fill up word by word as the words are heard.

const LINES = 2;
const SENTENCE_CHARACTERS = 30; // shorter sentences share a page
const SENTENCE_END = /[.!?…]["”’)]*$/;

export class Captions {
  #element;
  #enabled = true;

  constructor(element) {
    this.#element = element;
    this.clear();
  }

  set enabled(enabled) {
    this.#enabled = enabled;
    this.#show();
  }

  /** `word` begins to be heard. */
  add(word) {
    const last = this.#element.lastElementChild;
    const text = this.#element.textContent;
    if (text.length >= SENTENCE_CHARACTERS && SENTENCE_END.test(text)) this.#element.replaceChildren();
    else last?.classList.remove("now");
    if (this.#element.hasChildNodes()) this.#element.append(" ");
    const span = document.createElement("span");
    span.className = "now";
    span.textContent = word;
    this.#element.append(span);
    this.#show();
    this.#roll();
  }

  clear() {
    this.#element.replaceChildren();
    this.#show();
  }

  #show() {
    this.#element.hidden = !this.#enabled || !this.#element.hasChildNodes();
  }

  // The first line goes when a new one begins below.
  #roll() {
    if (this.#element.hidden) return;
    for (let tops = this.#tops(); new Set(tops).size > LINES; tops = this.#tops()) {
      const gone = tops.lastIndexOf(tops[0]) + 1;
      const { children } = this.#element;
      const stays = [...children].slice(gone).flatMap((span, index) => (index ? [" ", span] : [span]));
      this.#element.replaceChildren(...stays);
    }
  }

  #tops() {
    return [...this.#element.children].map((span) => span.offsetTop);
  }
}
