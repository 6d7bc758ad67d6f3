// What the server makes of the page's state: of the last of many states, a moment after it.

export class Latest {
  /** `pause`: milliseconds after a change; `make(text)`: has it made; `fail(error)`: says what went wrong. */
  constructor(pause, make, fail) {
    this.pause = pause;
    this.make = make;
    this.fail = fail;
    this.made = this.wanted = null;
  }

  /** Has a state made, as JSON, unless it is wanted already; null for nothing. */
  want(text) {
    if (text === this.wanted) return;
    this.wanted = text;
    clearTimeout(this.waiting);
    if (text === null) this.made = null;
    else this.waiting = setTimeout(() => this.ask(), this.pause);
  }

  /** While one is made, only the last state waits. */
  async ask() {
    if (this.asking) return;
    this.asking = true;
    try {
      while (this.wanted && this.made !== this.wanted) {
        this.made = this.wanted;
        await this.make(this.made);
      }
    } catch (error) {
      this.fail(error);
    } finally {
      this.asking = false;
    }
  }

  /** Ends what is on its way. */
  close() {
    this.want(null);
  }
}
